"""Floors, layers and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surveilnav.sensing.views import DetectedObject
from surveilnav.services.fusion.core import JointMap, in_order


def test_a_floor_is_known_by_its_altitude(world):
    joint = JointMap()
    for floor, z in (("0", 0.0), ("1", 2.8), ("0", 0.3), ("mezzanine", 0.35), ("1", 2.6)):
        joint.integrate(world.view(2, 2, 0, floor=floor, floor_z=z), None)
    assert joint.floors == {"0": 0.0, "1": pytest.approx(2.8)}
    assert joint.layer("mezzanine", "explored")[1].sum() == joint.layer("0", "explored")[1].sum() > 0
    assert joint.floor_revision("0") == 4
    assert joint.revision == joint.floor_revision("1") == 5


def test_one_name_for_two_altitudes_makes_two_floors(world):
    joint = JointMap()
    joint.integrate(world.view(2, 2, 0, floor="0"), None)
    joint.integrate(world.view(2, 2, 0, floor="0", floor_z=3.0), None)
    assert joint.floors == {"0": 0.0, "0-2": pytest.approx(3.0)}


def test_what_is_asked_for_must_be_there(world):
    joint = JointMap()
    joint.integrate(world.view(2, 2, 0), None)
    with pytest.raises(KeyError, match=r"there are maps of \['0'\]"):
        joint.layer("7", "explored")
    with pytest.raises(KeyError, match="occupancy"):
        joint.layer("0", "beauty")
    with pytest.raises(ValueError, match="text embedding"):
        joint.layer("0", "value")
    with pytest.raises(KeyError):
        joint.objects("7")


def broken(view, tools):
    bad = np.full(8, np.nan, np.float32)
    T = view.T_world_camera.copy()
    T[0, 3] = np.inf
    return {
        "depth of another size": (replace(view, depth_m=view.depth_m[:-1]), None),
        "colour of another type": (replace(view, rgb=view.rgb.astype(float)), None),
        "a pose from nowhere": (replace(view, T_world_camera=T), None),
        "a box of NaN": (view, tools.seen(DetectedObject("c", 0.5, (np.nan, 0, 5, 5), None, tools.unit(0)))),
        "an embedding of NaN": (view, tools.seen(DetectedObject("c", 0.5, (0, 0, 5, 5), None, bad))),
        "a picture's embedding of NaN": (view, tools.seen(image=bad)),
        "a mask of another size": (
            view,
            tools.seen(DetectedObject("c", 0.5, (0, 0, 5, 5), np.ones((3, 3), np.bool_), tools.unit(0))),
        ),
    }


@pytest.mark.parametrize(
    "what",
    [
        "depth of another size",
        "colour of another type",
        "a pose from nowhere",
        "a box of NaN",
        "an embedding of NaN",
        "a picture's embedding of NaN",
        "a mask of another size",
    ],
)
def test_a_broken_view_is_refused_and_changes_nothing(world, tools, what):
    joint = JointMap()
    view, perception = broken(world.view(2, 2, 0), tools)[what]
    with pytest.raises(ValueError):
        joint.integrate(view, perception)
    assert joint.revision == 0
    assert all(len(s.geometry.cloud.array()) == 0 for s in joint._floors.values())


def test_a_view_without_any_depth_is_no_problem(world, tools):
    view = world.view(2, 2, 0)
    joint = JointMap()
    done = joint.integrate(replace(view, depth_m=np.full_like(view.depth_m, np.nan)), tools.seen())
    assert (done.n_points, joint.layer("0", "cloud")[1].shape) == (0, (0, 6))
    assert np.isnan(joint.layer("0", "value", tools.unit(0))[1]).all()


def test_the_order_of_integration(world):
    views = [
        replace(world.view(1, 1, 0, source=s, view=v), stamp_ns=t)
        for t, s, v in ((2, "robot/a", 0), (1, "robot/b", 0), (1, "camera/z", 1), (1, "camera/z", 0))
    ]
    assert [(v.stamp_ns, v.source, v.view) for v in in_order(views)] == [
        (1, "camera/z", 0),
        (1, "camera/z", 1),
        (1, "robot/b", 0),
        (2, "robot/a", 0),
    ]


# --- stairs and split levels ----------------------------------------------------------------------------------------


def climb(joint, world, way, seq=0):
    """A robot's views along (x, altitude, floor name); the floors that they went to."""
    return [
        joint.accept(world.view(x, 2, 0.3, seq=seq + i, floor=floor, floor_z=z), None).floor
        for i, (x, z, floor) in enumerate(way)
    ]


@pytest.mark.parametrize("renamed_at", [0.3, 1.0, 2.0, 2.7, 9.9])
@pytest.mark.parametrize("step_m", [0.25, 0.08])
def test_a_stair_litters_no_floors(world, renamed_at, step_m):
    """Whenever the robot changes its mind about where it is, there are two floors at the end."""
    joint = JointMap()
    stair = [(1 + 1.2 * z / 2.8, z, "0" if z < renamed_at else "1") for z in np.arange(0.0, 2.8, 0.7 * step_m)]
    went = climb(joint, world, [(1.0, 0.0, "0"), *stair])
    assert set(went) == {"0"}
    top = [(2.2 + 0.2 * i, 2.8, "1") for i in range(12)]
    went = climb(joint, world, top, seq=len(went))
    assert went[-1] == "1"
    assert joint.floors == {"0": 0.0, "1": pytest.approx(2.8, abs=0.1)}
    assert joint.floor_revision("1") > joint.floor_revision("0")


def test_a_camera_upstairs_makes_the_floor_that_the_robot_arrives_on(world):
    joint = JointMap()
    climb(joint, world, [(1.0, 0.0, "0"), (1.2, 0.45, "0"), (1.4, 0.9, "0"), (1.6, 1.4, "1")])
    camera = world.view(5, 3, -2, -0.5, height=1.8, source="camera/c", floor="1", floor_z=2.8)
    assert joint.accept(camera, None).floor == "1"
    assert climb(joint, world, [(1.8, 1.9, "1"), (2.0, 2.3, "1"), (2.2, 2.5, "1"), (2.3, 2.8, "1")], seq=4) == [
        "0",
        "0",
        "1",
        "1",
    ]
    assert joint.floors == {"0": 0.0, "1": pytest.approx(2.8)}


def test_a_split_level_becomes_a_floor_of_its_own_once_a_robot_walks_on_it(world):
    joint = JointMap()
    up = [(1.0, 0.0, "0"), (1.2, 0.3, "0"), (1.4, 0.6, "0"), (1.6, 0.9, "0")]
    level = [(1.6 + 0.25 * i, 0.9, "0") for i in range(1, 8)]
    went = climb(joint, world, [*up, *level])
    assert went == ["0"] * 7 + ["0-2"] * 4
    assert joint.floors == {"0": 0.0, "0-2": pytest.approx(0.9)}
    assert climb(joint, world, [(3.4, 0.9, "0"), (3.2, 0.5, "0"), (3.0, 0.0, "0")], seq=20) == ["0-2", "0-2", "0"]


def test_looking_around_on_a_landing_makes_no_floor_unless_it_has_a_name(world):
    up = [(1.0, 0.0, "0"), (1.2, 0.5, "0"), (1.4, 1.0, "0"), (1.6, 1.4, "0")]
    for name, floors in (("0", {"0"}), ("landing", {"0", "landing"})):
        joint = JointMap()
        climb(joint, world, [*up, *[(1.6, 1.4, name)] * 12])
        assert set(joint.floors) == floors


def test_a_lift_or_a_camera_opens_a_floor_at_once(world):
    joint = JointMap()
    assert climb(joint, world, [(1.0, 0.0, "0"), (1.0, 5.6, "2")]) == ["0", "2"]
    camera = world.view(5, 3, -2, -0.5, height=1.8, source="camera/c", floor="0", floor_z=0.9)
    assert joint.accept(camera, None).floor == "0-2"


def test_a_name_called_too_early_still_finds_its_floor_later(world):
    joint = JointMap()
    climb(joint, world, [(1.0, 0.0, "0"), (1.2, 0.3, "1"), (1.4, 3.0, "1")])
    assert joint.floor_revision("1") == 3
    assert joint.floors == {"0": 0.0, "1": pytest.approx(3.0)}


def test_of_a_floor_nothing_is_known_of_everything_is_empty(world, tools):
    joint = JointMap.unseen("4", 11.2, (30.0, -7.0), JointMap().config)
    grid, explored = joint.layer("4", "explored")
    assert [int(i) for i in grid.cells_of((30.0, -7.0))] == [grid.rows // 2, grid.cols // 2]
    assert not explored.any()
    assert np.isnan(joint.layer("4", "value", tools.unit(0))[1]).all()
    assert (joint.objects("4"), joint.floor_revision("4"), joint.knows("5")) == ([], 0, False)
