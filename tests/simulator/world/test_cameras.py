from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from surveilnav.camera_plan import AZIMUTHS
from surveilnav.contract import CAMERA_INFO
from surveilnav.errors import ConfigError
from surveilnav.simulator.world.cameras import CAMERA, _spread_count, place_cameras
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Floor, Stair

TWO_FLOORS = (Floor("0", "ground", 0.0, 2.5), Floor("attic", "attic", 2.7, 2.5))


@pytest.fixture(scope="module")
def house(boxes, room):
    """150 m2 below, 50 m2 above, joined by a stair."""
    stair = Stair("0", "attic", (1.0, 1.0, 0.0), (3.0, 1.0, 2.7), 4.0)
    scene = boxes([*room(15.0, 10.0), *room(10.0, 5.0, "attic", 2.7)], TWO_FLOORS, (stair,))
    return scene, NavigationMap.build(scene)


def test_density_as_in_the_paper(house) -> None:
    def floors(**kw) -> list[str]:
        return [c.floor for c in place_cameras(*house, **kw)]

    assert floors() == ["0", "0", "attic"], "one per 100 m2, every floor at least one"
    assert floors(area_per_camera_m2=200.0) == ["0", "attic"]
    assert floors(area_per_camera_m2=25.0) == ["0"] * 7 + ["attic"] * 3  # 155 and 53 m2 with what lies under the walls
    assert floors(count=8) == ["0"] * 6 + ["attic"] * 2
    assert floors(count=1) == ["0"]
    assert floors(count=0) == []


@pytest.mark.parametrize(
    ("count", "areas", "expected"),
    [
        (8, [100.0, 100.0], [4, 4]),
        (8, [90.0, 10.0], [7, 1]),
        (3, [97.0, 1.0, 1.0], [1, 1, 1]),
        (2, [10.0, 90.0, 50.0], [0, 1, 1]),
        (5, [50.0, 0.0], [5, 0]),
        (4, [0.0, 0.0], [0, 0]),
    ],
)
def test_a_count_is_spread_by_area(count, areas, expected) -> None:
    assert _spread_count(count, areas) == expected


def test_a_camera_and_its_views(house) -> None:
    scene, nav = house
    cameras = place_cameras(scene, nav, count=4)
    assert [c.name for c in cameras] == ["c0-1", "c0-2", "c0-3", "c1-1"]
    for camera in cameras:
        CAMERA_INFO.key_for(building="b", floor=camera.floor, camera=camera.name)
        assert camera.position_m[2] == pytest.approx(nav.floors[camera.floor].z_m + 1.8)
        assert nav.is_navigable(camera.position_m, camera.floor)
        assert len(camera.views) == 13
        for k, T in enumerate(camera.views):
            assert np.allclose(T[:3, 3], camera.position_m)
            forward = T[:3, 2]
            if k == AZIMUTHS:
                assert np.allclose(forward, [0, 0, -1])
            else:
                assert math.degrees(math.asin(forward[2])) == pytest.approx(-30.0)
                turn = math.degrees(math.atan2(forward[1], forward[0])) - 30.0 * k
                assert (turn + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)
        half = camera.half()
        assert len(set(half)) == 6
        assert all((b - a) % AZIMUTHS == 1 for a, b in itertools.pairwise(half))
    assert (CAMERA.width_px, CAMERA.height_px) == (1280, 1280)
    assert math.degrees(CAMERA.hfov_rad) == pytest.approx(100.0)


def test_the_half_looks_away_from_the_wall(boxes, room) -> None:
    """A corridor along +x that a camera stands at the end of: the half must hold azimuth 0."""
    scene = boxes([*room(12.0, 1.2)])
    cameras = place_cameras(scene, NavigationMap.build(scene), count=3)
    for camera in cameras:
        x = camera.position_m[0]
        if x < 2.0:
            assert 0 in camera.half()
            assert 6 not in camera.half()
        if x > 10.0:
            assert 6 in camera.half()
            assert 0 not in camera.half()
    assert sum(c.position_m[0] < 2.0 or c.position_m[0] > 10.0 for c in cameras) == 2


def test_the_same_seed_gives_the_same_plan(house) -> None:
    plan = [c.position_m for c in place_cameras(*house, count=6)]
    assert plan == [c.position_m for c in place_cameras(*house, count=6)]
    assert plan != [c.position_m for c in place_cameras(*house, count=6, seed=1)]


def test_farthest_points_by_the_way_one_walks(boxes, room) -> None:
    """Two corridors side by side that meet in a hall at their western end: their eastern ends are a metre apart by air
    and 30 m on foot, so each gets a camera."""
    wall = ("wall", "0", (4.0, 1.45, 0.0), (20.0, 1.55, 2.5))
    hall_wall = ("wall", "0", (4.0, 3.0, 0.0), (20.0, 6.0, 2.5))
    scene = boxes([*room(20.0, 6.0), wall, hall_wall])
    cameras = place_cameras(scene, NavigationMap.build(scene), count=3)
    ends = [c.position_m for c in cameras if c.position_m[0] > 18.0]
    assert len(ends) == 2
    assert (ends[0][1] < 1.5) != (ends[1][1] < 1.5)


def test_each_camera_is_as_far_from_those_before_it_as_can_be(house) -> None:
    scene, nav = house
    cameras = [c for c in place_cameras(scene, nav, count=8) if c.floor == "0"]
    for k in range(1, len(cameras)):
        field = nav.distance_field({"0": [c.position_m for c in cameras[:k]]})
        farthest = field.distance_m["0"][nav.robot_area["0"]].max()
        assert field.at(cameras[k].position_m, "0") >= 0.85 * farthest, "candidates are a sample"


@pytest.mark.parametrize(("low", "high"), [(1.7, 2.4), (1.2, 2.3), (1.3, 1.35)])
def test_bad_viewpoints_are_skipped(boxes, room, low, high) -> None:
    """Half of the room lies under a loft, which the robot passes under and a camera would be inside or on top of."""
    scene = boxes([*room(6.0, 4.0), ("", "0", (3.0, 0.0, low), (6.0, 4.0, high))])
    nav = NavigationMap.build(scene)
    assert nav.is_navigable((4.5, 2.0), "0")
    for seed in range(3):
        cameras = place_cameras(scene, nav, count=8, seed=seed)
        assert len(cameras) == 8
        assert all(c.position_m[0] < 3.0 for c in cameras)


def test_a_broom_cupboard_gets_no_camera(boxes, room) -> None:
    """A niche of 0.8 x 1.2 m at the end of the room, open to it: far away, but one would only film its walls."""
    blocks = [("wall", "0", (6.0, 0.0, 0.0), (7.2, 1.6, 2.5)), ("wall", "0", (6.0, 2.4, 0.0), (7.2, 4.0, 2.5))]
    scene = boxes([*room(7.2, 4.0), *blocks])
    nav = NavigationMap.build(scene)
    assert nav.is_navigable((6.8, 2.0), "0")
    assert max(c.position_m[0] for c in place_cameras(scene, nav, count=8)) < 6.4


def test_where_every_viewpoint_is_bad_the_least_bad_stand(boxes, room) -> None:
    scene = boxes([*room(3.0, 3.0), ("", "0", (-0.1, -0.1, 1.7), (3.1, 3.1, 2.4))])
    assert len(place_cameras(scene, NavigationMap.build(scene), count=2)) == 2


def test_open_air_is_bad(boxes, room) -> None:
    """A terrace without walls beside a room: most of what a camera saw there would be nothing."""
    room_without_east = [b for b in room(5.0, 4.0) if b[2][0] != 5.0]
    terrace = ("floor", "0", (5.0, -0.1, -0.1), (30.0, 4.1, 0.0))
    scene = boxes([*room_without_east, terrace])
    cameras = place_cameras(scene, NavigationMap.build(scene), count=4)
    assert all(c.position_m[0] < 8.0 for c in cameras)


@pytest.mark.parametrize("settings", [{"area_per_camera_m2": 0.0}, {"area_per_camera_m2": math.nan}, {"count": -1}])
def test_senseless_settings(house, settings) -> None:
    with pytest.raises(ConfigError, match=r"got"):
        place_cameras(*house, **settings)


def test_floors_that_robots_cant_get_to_have_no_camera_unless_asked(boxes, room) -> None:
    scene = boxes([*room(15.0, 10.0), *room(10.0, 5.0, "attic", 2.7)], TWO_FLOORS)
    nav = NavigationMap.build(scene)
    assert {c.floor for c in place_cameras(scene, nav)} == {"0"}
    assert [c.floor for c in place_cameras(scene, nav, count=3)] == ["0"] * 3
    assert {c.floor for c in place_cameras(scene, nav, everywhere=True)} == {"0", "attic"}
