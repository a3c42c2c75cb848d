"""Views whose depth is estimated: what they add to the maps, and that whoever measures wins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.benchmark.play.depth_error import DepthError
from surveilnav.geometry import Pinhole
from surveilnav.occupancy import ESTIMATED_OBSTACLE, OBSTACLE
from surveilnav.services.fusion.core import FusionConfig, JointMap, snapshot

LENS = Pinhole.from_hfov(200, 160, math.radians(90))
ERROR = DepthError(0.15, 0.06)


def at(joint, name, x, y, margin_m=0.0):
    """The largest value of a layer within ``margin_m`` of a place."""
    grid, array = joint.layer("0", name)
    n = round(margin_m / grid.resolution_m)
    row, col = grid.cells_of((x, y))
    return int(array[row - n : row + n + 1, col - n : col + n + 1].max())


def estimated(world, seed=0, error=ERROR, yaw=0.0, **where):
    more = {"height": 2.3, "source": "camera/c", "camera": LENS, "seq": seed + 1} | where
    view = world.view(0.3, 2.0, yaw, -0.5, **more)
    return replace(
        view, depth_m=error.apply(view.depth_m, seed), depth_source="network", depth_uncertainty=error.uncertainty
    )


@pytest.fixture
def room(world):
    world.boxes["table"] = ((2.2, 1.6, 0.0), (2.8, 2.4, 0.75))
    return world


def test_it_maps_floor_and_estimated_obstacles_but_no_points(room):
    joint = JointMap()
    for seed in range(4):
        joint.accept(estimated(room, seed, view=seed), None)
    assert at(joint, "explored", 1.5, 2.0) == 1
    assert at(joint, "occupancy", 1.5, 2.0) == 0
    assert at(joint, "occupancy", 2.25, 2.0, margin_m=0.25) == ESTIMATED_OBSTACLE
    assert OBSTACLE not in joint.layer("0", "occupancy")[1]
    assert len(joint.layer("0", "cloud")[1]) == 0


def test_a_camera_doesnt_explore_farther_than_one_with_a_sensor(room):
    joint = JointMap()
    joint.accept(estimated(room), None)
    assert at(joint, "explored", 0.3 + 3.2, 2.0) == 0


@pytest.mark.parametrize("sensor_first", [True, False])
def test_what_a_sensor_sees_wins_whenever_it_comes(world, sensor_first):
    """The camera sees a table where a robot sees bare floor; and no table where the robot sees one."""
    robots = JointMap()
    seen = [world.view(1.0, 2.0, 0.0, -0.5, seq=i + 1) for i in range(2)]
    for view in seen:
        robots.accept(view, None)
    world.boxes["ghost"] = ((1.9, 1.6, 0.0), (2.5, 2.4, 0.75))
    ghosts = [estimated(world, seed, view=seed) for seed in range(4)]
    joint = JointMap()
    for view in [*seen, *ghosts] if sensor_first else [*ghosts, *seen]:
        joint.accept(view, None)
    assert at(joint, "occupancy", 2.0, 2.0, margin_m=0.1) == 0
    grid, explored = robots.layer("0", "explored")
    for x, y in grid.centres_of(np.argwhere(explored)):
        assert at(joint, "occupancy", x, y) == at(robots, "occupancy", x, y)


def test_its_order_does_not_matter(room):
    views = [estimated(room, seed, view=seed, yaw=0.3 * seed - 0.6) for seed in range(5)]
    views += [room.view(1.0, 1.0, 0.4, -0.3, seq=i) for i in range(2)]
    one, other = JointMap(), JointMap()
    for a, b in zip(views, views[::-1], strict=True):
        one.integrate(a, None)
        other.integrate(b, None)
    for name in ("occupancy", "explored", "frontier"):
        for x in np.arange(0.0, 6.0, 0.31):
            for y in np.arange(0.0, 4.0, 0.29):
                assert at(one, name, x, y) == at(other, name, x, y)


def test_without_floor_in_view_it_counts_as_a_view_without_depth(room):
    joint = JointMap()
    view = estimated(room)
    result = joint.accept(replace(view, T_world_camera=room.view(0.3, 2.0, 0.0, 0.9, height=2.3).T_world_camera), None)
    assert result is not None
    assert result.n_points == 0
    assert not joint.layer("0", "explored")[1].any()


def test_it_survives_a_snapshot(room):
    joint = JointMap()
    for seed in range(3):
        joint.accept(estimated(room, seed, view=seed), None)
    again = snapshot.load(snapshot.dump(joint), FusionConfig())
    assert snapshot.dump(again) == snapshot.dump(joint)
    np.testing.assert_array_equal(again.layer("0", "occupancy")[1], joint.layer("0", "occupancy")[1])


def test_a_thing_above_the_floor_is_located_by_its_estimated_depth(world, tools):
    """A tv on a sideboard: its foot isn't on the floor, so depth says where it is, and how surely."""
    world.boxes |= {"sideboard": ((3.0, 1.4, 0.0), (3.5, 2.6, 0.7)), "tv": ((3.1, 1.6, 0.7), (3.2, 2.4, 1.2))}
    joint = JointMap()
    view = estimated(world, 3, DepthError(0.05, 0.04))
    result = joint.accept(view, tools.seen(world.detect(view, "tv", "tv", 0.9, tools.unit(0))))
    assert result is not None
    (tv,) = joint.objects("0")
    assert tv.position_sigma_m > 0.1
    assert math.dist(tv.center_m[:2], (3.15, 2.0)) < 2 * tv.position_sigma_m
    assert tv.status != "confirmed"
