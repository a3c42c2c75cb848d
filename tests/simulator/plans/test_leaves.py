from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.simulator.furniture.catalog import Furniture
from surveilnav.simulator.plans.leaves import without_leaf
from surveilnav.simulator.plans.openings import is_moving_part
from surveilnav.simulator.plans.placing import placed
from surveilnav.simulator.plans.sweethome import Piece
from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.scene import Material

GREY = Material("grey", (0.5, 0.5, 0.5))
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


def piece(width: float = 1.0, height: float = 2.1, depth: float = 0.2) -> Piece:
    return Piece("Door", "", "", "", 0.0, 0.0, 0.0, (width, depth, height), 0.0, is_opening=True)


def boxes(*solids: Box) -> Mesh:
    mesh = MeshBuilder()
    for low, high in solids:
        mesh.box(low, high, GREY)
    return mesh.mesh()


def extent(mesh: Mesh) -> set[tuple[float, ...]]:
    """The boxes that are left, as (x0, z0, x1, z1)."""
    corners = mesh.vertices[mesh.triangles].reshape(-1, 36, 3)  # a box has twelve triangles
    return {tuple(np.round([*c.min(axis=0)[[0, 2]], *c.max(axis=0)[[0, 2]]], 2).tolist()) for c in corners}


def frame(width: float, height: float = 2.1) -> list[Box]:
    half = width / 2
    return [
        ((-half, -0.1, 0), (0.05 - half, 0.1, height)),
        ((half - 0.05, -0.1, 0), (half, 0.1, height)),
        ((0.05 - half, -0.1, height - 0.05), (half - 0.05, 0.1, height)),
        ((0.05 - half, -0.1, 0), (half - 0.05, 0.1, 0.02)),
    ]


@pytest.mark.parametrize(
    ("width", "leaf"),
    [
        (1.0, [((-0.45, -0.02, 0.02), (0.45, 0.02, 2.05))]),
        (1.0, [((-0.45, -0.02, 0.02), (-0.41, 0.6, 2.05)), ((-0.41, 0.3, 0.02), (0.2, 0.34, 2.05))]),  # half open
        (2.0, [((-0.95, -0.02, 0.02), (0.0, 0.02, 2.05)), ((0.0, -0.02, 0.02), (0.95, 0.02, 2.05))]),  # two leaves
        (2.0, [((-0.95, 0.02, 0.02), (0.05, 0.05, 2.05)), ((-0.05, -0.05, 0.02), (0.95, -0.02, 2.05))]),  # sliding
        (1.0, [((-0.45, -0.02, 0.02), (0.45, 0.02, 2.05)), ((0.36, -0.09, 1.0), (0.4, 0.09, 1.1))]),  # a handle
        (1.0, [((-0.3, 0.0, 0.3), (0.3, 0.01, 1.9)), ((-0.28, -0.02, 0.02), (0.28, 0.02, 0.22))]),  # a pane, a rail
    ],
)
def test_leaves_go_and_frames_stay(width: float, leaf: list[Box]) -> None:
    left = extent(without_leaf(boxes(*frame(width), *leaf), piece(width), 0.0))
    gone = extent(boxes(*leaf))
    stays = extent(boxes(*frame(width)))
    assert stays <= left
    assert not [box for box in left & gone if box[0] > -0.44]  # what stands aside at the hinge may stay


@given(yaw=st.floats(-7, 7), x=st.floats(-50, 50), y=st.floats(-50, 50), z=st.floats(-3, 9))
def test_it_is_the_same_wherever_the_door_is(yaw: float, x: float, y: float, z: float) -> None:
    door = boxes(*frame(1.0), ((-0.45, -0.02, 0.02), (0.45, 0.02, 2.05)))
    c, s = math.cos(yaw), math.sin(yaw)
    T = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z + 0.02], [0, 0, 0, 1]])
    there = without_leaf(door.moved(T), replace(piece(), x_m=x, y_m=y, z_m=0.02, yaw_rad=yaw), z)
    assert len(there.triangles) == 4 * 12
    assert len(there.vertices) == len(np.unique(there.triangles))


def test_a_frame_without_a_leaf_and_a_high_hatch_are_left_alone() -> None:
    bare = boxes(*frame(1.0))
    assert without_leaf(bare, piece(), 0.0) is bare
    low = boxes(((-0.5, 0, 0), (0.5, 0.1, 0.4)))
    assert without_leaf(low, piece(height=0.4), 0.0) is low


def test_leaf_and_frame_in_one_piece_come_apart() -> None:
    """A slab of posts and leaf whose corners are shared."""
    xs, zs = [-0.5, -0.42, 0.42, 0.5], [0.0, 2.02, 2.1]
    points = np.array([[x, 0.0, z] for z in zs for x in xs])
    quads = [(r * 4 + c, r * 4 + c + 1, r * 4 + c + 5, r * 4 + c + 4) for r in range(2) for c in range(3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    mesh = MeshBuilder()
    mesh.triangles(points, triangles, GREY)
    left = without_leaf(mesh.mesh(), piece(), 0.0)
    assert len(left.triangles) == 10  # the middle of the lower row is gone
    assert left.vertices[:, 0].min() == pytest.approx(-0.5)


def test_the_catalogues_own_leaves_are_found_without_their_names(assets: Path, tmp_path: Path) -> None:
    checked = 0
    with Furniture(assets, tmp_path) as furniture:
        for entry_id in (
            "eTeks#door",
            "eTeks#roundedDoor",
            "eTeks#frontDoor",
            "Scopia#glass_door",
            "Scopia#double_door",
        ):
            entry = furniture.by_id[entry_id]
            model = furniture.load(entry)
            named = np.array([is_moving_part(name) for name in model.group_names])[model.group]
            door = replace(piece(), size_m=entry.size_m)
            left = without_leaf(placed(model, door, entry.rotation, 0.0), door, 0.0)
            bare = without_leaf(placed(model.without_groups(is_moving_part), door, entry.rotation, 0.0), door, 0.0)
            assert len(bare.triangles) == (~named).sum()  # where names have opened it nothing more goes
            assert _area(left) == pytest.approx(_area(placed(model, door, entry.rotation, 0.0), ~named), rel=0.02)
            checked += 1
    assert checked == 5


def _area(mesh: Mesh, chosen: np.ndarray | None = None) -> float:
    corners = mesh.vertices[mesh.triangles if chosen is None else mesh.triangles[chosen]].astype(float)
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    )
