"""Buildings made of plain boxes, whose geometry can be written down in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import AssetError, TargetError
from surveilnav.simulator.world.goals import find_goals
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Floor, Instance, Material, Scene, Stair

Box = tuple[str, str, tuple[float, float, float], tuple[float, float, float]]
_FACES = ((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3))  # fmt: skip  # noqa: E501


def scene_of_boxes(boxes: Sequence[Box], floors: Sequence[Floor] | None = None, stairs: Sequence[Stair] = ()) -> Scene:
    """A scene of (label, floor id, low corner, high corner); instance ids count from 1 in that order."""
    vertices, triangles, owner, instances = [], [], [], []
    for number, (label, floor, low, high) in enumerate(boxes, start=1):
        corners = [[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
        triangles.append(np.array(_FACES) + 8 * (number - 1))
        vertices.append(np.array(corners))
        owner += [number] * len(_FACES)
        instances.append(Instance(number, f"{label}-{number}", label, floor, low, high))
    n = len(owner)
    return Scene(
        name="boxes",
        vertices=np.concatenate(vertices).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        uvs=np.zeros((n, 3, 2), dtype=np.float32),
        material_of_triangle=np.zeros(n, dtype=np.int32),
        instance_of_triangle=np.array(owner, dtype=np.uint16),
        materials=(Material("grey", (0.5, 0.5, 0.5)),),
        instances=tuple(instances),
        rooms=(),
        floors=tuple(floors or (Floor("0", "ground", 0.0, 2.5),)),
        stairs=tuple(stairs),
        content_hash="boxes",
    )


def room_of_boxes(width_m: float, depth_m: float, floor: str = "0", z_m: float = 0.0) -> list[Box]:
    """Floor, ceiling and four walls around [0, width] x [0, depth], 2.5 m high."""
    w, d, z, top = width_m, depth_m, z_m, z_m + 2.5
    return [
        ("floor", floor, (-0.1, -0.1, z - 0.1), (w + 0.1, d + 0.1, z)),
        ("ceiling", floor, (-0.1, -0.1, top), (w + 0.1, d + 0.1, top + 0.02)),
        ("wall", floor, (-0.1, -0.1, z), (w + 0.1, 0.0, top)),
        ("wall", floor, (-0.1, d, z), (w + 0.1, d + 0.1, top)),
        ("wall", floor, (-0.1, 0.0, z), (0.0, d, top)),
        ("wall", floor, (w, 0.0, z), (w + 0.1, d, top)),
    ]


@pytest.fixture(scope="session")
def boxes() -> Callable[..., Scene]:
    return scene_of_boxes


@pytest.fixture(scope="session")
def room() -> Callable[..., list[Box]]:
    return room_of_boxes


@pytest.fixture(scope="session")
def assets() -> Path:
    """The Sweet Home 3D packages."""
    from surveilnav.simulator.furniture.assets import ensure_assets

    try:
        return ensure_assets()
    except AssetError as error:
        pytest.skip(f"the Sweet Home 3D packages can't be had: {error}")


@pytest.fixture(scope="session")
def targets_in() -> Callable[[Scene, NavigationMap], dict[str, int]]:
    """How many instances of each class a robot can get to; classes without any are left out."""

    def count(scene: Scene, navigation: NavigationMap) -> dict[str, int]:
        caster = RayCaster(scene)
        found = {}
        for label in sorted(set(scene.labels_by_id.values())):
            with suppress(TargetError):
                found[label] = len(find_goals(scene, navigation, label, caster=caster).instances)
        return found

    return count
