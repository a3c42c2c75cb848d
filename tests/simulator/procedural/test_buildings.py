"""Generated buildings as scenes: a robot gets everywhere, and finds what there is to find."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import AssetError, BuildingError
from surveilnav.simulator import sources
from surveilnav.simulator.sources import list_buildings, open_building
from surveilnav.simulator.world.labels import TARGETS
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.polygons import contains
from surveilnav.simulator.world.scene import Scene


@pytest.fixture
def no_assets(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> Path:
        raise AssetError("none here")

    monkeypatch.setattr(sources, "ensure_assets", refuse)


def check_robot_gets_everywhere(scene: Scene, targets_in) -> dict[str, int]:
    """All floors connected, nearly all rooms entered; returns the targets within reach."""
    navigation = NavigationMap.build(scene)
    assert len(scene.stairs) == len(scene.floors) - 1
    assert len(navigation.transits) == len(scene.stairs)
    entered = 0
    for room in scene.rooms:
        floor = navigation.floors[room.floor]
        xy = floor.grid.centres_of(np.argwhere(navigation.robot_area[room.floor]))
        entered += any(contains(np.array(room.polygon_m), p) for p in xy[:: max(1, len(xy) // 4000)])
    assert entered >= 0.95 * len(scene.rooms)
    for floor in navigation.floors.values():
        assert navigation.robot_area[floor.id].sum() >= 0.9 * floor.free.sum()
    return targets_in(scene, navigation)


@pytest.mark.usefixtures("no_assets")
def test_without_assets_simple_shapes_stand_in(tmp_path: Path, targets_in) -> None:
    scene = open_building("flats_1", cache_dir=tmp_path)
    assert scene.name == "flats_1-s0"
    assert "none here" in " ".join(scene.notes)
    assert [f.id for f in scene.floors] == [str(i) for i in range(len(scene.floors))]
    assert len(scene.floors) > 1
    found = check_robot_gets_everywhere(scene, targets_in)
    assert set(found) >= set(TARGETS)
    assert open_building("flats_1", cache_dir=tmp_path).content_hash == scene.content_hash
    assert open_building("Flats-1 ", cache_dir=tmp_path).content_hash == scene.content_hash
    assert open_building("flats_1", seed=1, cache_dir=tmp_path).content_hash != scene.content_hash


@pytest.mark.usefixtures("no_assets")
@pytest.mark.parametrize("name", ["office_3"])
def test_an_office_without_assets(name: str, tmp_path: Path, targets_in) -> None:
    found = check_robot_gets_everywhere(open_building(name, cache_dir=tmp_path), targets_in)
    assert set(found) >= {"chair", "toilet"}


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
def test_furnished_flats_the_same_twice(targets_in) -> None:
    scene = open_building("flats_1", seed=2, models="val")
    assert scene.name == "flats_1-s2-val"
    assert scene.notes == ()
    assert len(scene.triangles) < 5_000_000
    found = check_robot_gets_everywhere(scene, targets_in)
    assert set(found) >= {"chair", "toilet", "couch", "potted plant"}
    assert open_building("flats_1", seed=2, models="val").content_hash == scene.content_hash
    assert any("CC BY" in credit for credit in scene.credits)


def test_they_are_listed_and_named_in_errors(tmp_path: Path) -> None:
    listed = {b.name: b for b in list_buildings()}
    assert "office_<n>" in listed
    assert "flats_<n>" in listed
    with pytest.raises(BuildingError, match=r"office_<n>, flats_<n>"):
        open_building("office_x", cache_dir=tmp_path)
    with pytest.raises(BuildingError, match="all, train, val"):
        open_building("office_1", models="test")  # type: ignore[arg-type]
