"""Our own buildings written as GLB and as HM3D's folder, and read back."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import AssetError
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.simulator.meshes import export_glb, export_hm3d
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Instance, Scene

pytest.importorskip("trimesh")

Pair = tuple[Scene, Scene]
CAMERA = Pinhole.from_hfov(160, 120, math.radians(90.0))


def as_glb(scene: Scene, folder: Path) -> str:
    export_glb(scene, folder / "building.glb")
    return str(folder / "building.glb")


def as_hm3d(scene: Scene, folder: Path) -> str:
    export_hm3d(scene, folder / "00800-building")
    return str(folder / "00800-building")


BUILDINGS = ["parametric_flat", "parametric_house", pytest.param("studio", marks=pytest.mark.assets)]


@pytest.fixture(scope="module", params=BUILDINGS)
def original(request: pytest.FixtureRequest) -> Scene:
    try:
        return open_building(request.param)
    except AssetError as error:
        pytest.skip(f"{request.param} can't be had: {error}")


@pytest.fixture(scope="module", params=[as_glb, as_hm3d])
def pair(request: pytest.FixtureRequest, original: Scene, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    write: Callable[[Scene, Path], str] = request.param
    return original, open_building(write(original, tmp_path_factory.mktemp("mesh")))


def named(scene: Scene) -> list[Instance]:
    labels = scene.labels_by_id
    return sorted((i for i in scene.instances if i.id in labels), key=lambda i: (i.label, i.p_min, i.p_max))


def test_floors_are_found_again(pair: Pair) -> None:
    before, after = pair
    assert [f.id for f in after.floors] == [f.id for f in before.floors]
    for a, b in zip(before.floors, after.floors, strict=True):
        assert b.z_m == pytest.approx(a.z_m, abs=0.05)
        assert b.height_m == pytest.approx(a.height_m, abs=0.15)


def test_things_keep_class_floor_and_place(pair: Pair) -> None:
    before, after = pair
    assert [(i.label, i.floor) for i in named(after)] == [(i.label, i.floor) for i in named(before)]
    for a, b in zip(named(before), named(after), strict=True):
        np.testing.assert_allclose([b.p_min, b.p_max], [a.p_min, a.p_max], atol=0.02)
    for label in ("wall", "floor", "ceiling", "stairs", "door", "window"):
        assert len(after.labelled(label)) == len(before.labelled(label))


def test_materials_keep_colour_glass_and_gloss(pair: Pair) -> None:
    def used(scene: Scene) -> set[tuple]:
        materials = (scene.materials[i] for i in np.unique(scene.material_of_triangle))
        return {(m.name, *np.round([*m.color, m.alpha, m.shininess], 4).tolist()) for m in materials}

    assert used(pair[1]) == used(pair[0])


def test_pictures_are_the_same(pair: Pair) -> None:
    before, after = pair
    rng = np.random.default_rng(4)
    navigation = NavigationMap.build(before)
    eyes = [navigation.random_point(rng, before.floors[i % len(before.floors)].id) for i in range(5)]
    first, second = (Renderer(s, lighting="flat") for s in pair)
    same_label = 0.0
    for i, (x, y, z) in enumerate(eyes):
        T = camera_pose((x, y, z + 1.2), 1.3 * i, math.radians(-15.0))
        a, b = first.render(T, CAMERA), second.render(T, CAMERA)
        assert (np.abs(a.depth_m - b.depth_m) < 0.01).mean() > 0.99
        assert (np.abs(a.rgb.astype(int) - b.rgb.astype(int)).max(axis=-1) <= 8).mean() > 0.99
        labels = [
            np.vectorize(lambda n, s=s: s.labels_by_id.get(n, ""))(r.instance_ids) for s, r in ((before, a), (after, b))
        ]
        same_label += float((labels[0] == labels[1]).mean()) / len(eyes)
    assert same_label > 0.99


def test_robots_can_do_the_same(pair: Pair, targets_in) -> None:
    before, after = (NavigationMap.build(scene) for scene in pair)
    for a, b in zip(before.floors.values(), after.floors.values(), strict=True):
        assert b.free.sum() == pytest.approx(a.free.sum(), rel=0.05)
        assert b.floor_area_m2 == pytest.approx(a.floor_area_m2, rel=0.05)
    targets = [targets_in(s, n) for s, n in zip(pair, (before, after), strict=True)]
    assert targets[0] == targets[1]
    assert targets[0]


def test_stairs_are_found_again(pair: Pair) -> None:
    before, after = pair
    assert [(s.lower_floor, s.upper_floor) for s in after.stairs] == [
        (s.lower_floor, s.upper_floor) for s in before.stairs
    ]
    for a, b in zip(before.stairs, after.stairs, strict=True):
        # We end where a robot first has room, the plan where somebody drew it.
        np.testing.assert_allclose([b.lower_m, b.upper_m], [a.lower_m, a.upper_m], atol=0.6)
        steps = math.dist(b.lower_m, b.upper_m)
        assert steps - 0.1 < b.length_m < 1.1 * steps
    maps = [NavigationMap.build(scene) for scene in pair]
    assert len(maps[1].transits) == len(maps[0].transits)
    for floor in before.floors:
        assert maps[1].robot_area[floor.id].sum() == pytest.approx(maps[0].robot_area[floor.id].sum(), rel=0.05)


def test_rooms_are_outlines_of_floors(pair: Pair) -> None:
    _, after = pair
    assert {room.floor for room in after.rooms} == {floor.id for floor in after.floors}


def test_reading_twice_gives_the_same_scene(original: Scene, tmp_path: Path) -> None:
    path = as_glb(original, tmp_path)
    assert open_building(path).content_hash == open_building(path).content_hash != original.content_hash
