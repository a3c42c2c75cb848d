from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from surveilnav.errors import TargetError
from surveilnav.simulator.world.goals import find_goals, judge, sample_start
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Floor, Stair

COUCH_LOW, COUCH_HIGH = (9.0, 1.0, 0.0), (9.9, 3.0, 0.8)


@dataclass(frozen=True)
class State:
    p_world: tuple[float, float, float]
    floor: str = "0"
    path_m: float = 0.0
    stopped: bool = True


@pytest.fixture(scope="module")
def home(boxes, room):
    """10 x 5 m; a wall with a door at the top hides the couch on the right; a bed on the left stands by it."""
    wall = ("wall", "0", (4.95, 0.0, 0.0), (5.05, 4.0, 2.5))
    bed = ("bed", "0", (4.0, 0.1, 0.0), (4.9, 2.0, 0.5))
    closet = [("wall", "0", a, b) for a, b in (((0, 4.2, 0), (1, 4.3, 2.5)), ((1, 4.2, 0), (1.1, 5, 2.5)))]
    boxed_in = ("tv", "0", (0.3, 4.5, 0.4), (0.7, 4.8, 0.8))
    scene = boxes([*room(10.0, 5.0), wall, bed, *closet, boxed_in, ("couch", "0", COUCH_LOW, COUCH_HIGH)])
    return scene, NavigationMap.build(scene)


def test_viewpoints_are_near_navigable_and_see_the_object(home) -> None:
    scene, nav = home
    goals = find_goals(scene, nav, "couch")
    points = goals.viewpoints["0"]
    assert [i.label for i in goals.instances] == ["couch"]
    away = np.linalg.norm(points - np.clip(points, COUCH_LOW[:2], COUCH_HIGH[:2]), axis=1)
    assert away.max() <= 1.0
    assert away.max() > 0.9
    assert all(nav.is_navigable(p, "0") for p in points)
    # Nothing stands in the way here: every navigable cell within reach is one.
    cells = np.argwhere(nav.robot_area["0"])
    xy = nav.floors["0"].grid.centres_of(cells)
    within = np.linalg.norm(xy - np.clip(xy, COUCH_LOW[:2], COUCH_HIGH[:2]), axis=1) <= 1.0
    assert len(points) == within.sum()


def test_no_viewpoint_behind_a_wall(home) -> None:
    points = find_goals(*home, "bed").viewpoints["0"]
    assert (points[:, 0] < 4.95).all(), "the far side of the wall is within a metre of the bed, but doesn't see it"


def test_targets_and_their_errors(home, boxes, room, targets_in) -> None:
    scene, nav = home
    assert targets_in(scene, nav) == {"bed": 1, "couch": 1}
    assert find_goals(scene, nav, " Sofa ").label == find_goals(scene, nav, "canapé").label == "couch"
    with pytest.raises(TargetError, match="no 'Tür'"):
        find_goals(scene, nav, "Tür")
    with pytest.raises(TargetError, match=r"no 'toilet' in boxes; robots can get to bed \(1\), couch \(1\)$"):
        find_goals(scene, nav, "toilet")
    with pytest.raises(TargetError, match=r"robots can't get within 1 m .* another target: bed \(1\), couch \(1\)$"):
        find_goals(scene, nav, "tv")
    with pytest.raises(TargetError, match="no 'wall'"):
        find_goals(scene, nav, "wall")
    empty = boxes(room(4.0, 4.0))
    with pytest.raises(TargetError, match="nothing with a name"):
        find_goals(empty, NavigationMap.build(empty), "bed")


def test_an_unreachable_instance_is_no_goal_but_named(boxes, room) -> None:
    wall = ("wall", "0", (5.0, 0.0, 0.0), (5.1, 4.0, 2.5))
    near, far = ("chair", "0", (1, 1, 0), (1.5, 1.5, 0.9)), ("chair", "0", (7, 1, 0), (7.5, 1.5, 0.9))
    scene = boxes([*room(8.0, 4.0), wall, near, far])
    goals = find_goals(scene, NavigationMap.build(scene), "chair")
    assert [i.p_min[0] for i in goals.instances] == [1]
    assert [i.p_min[0] for i in goals.unreachable] == [7]


@pytest.mark.parametrize("seed", range(8))
def test_a_start_keeps_the_rules(home, seed: int) -> None:
    scene, nav = home
    goals = find_goals(scene, nav, "couch")
    start = sample_start(scene, nav, goals, seed=seed)
    assert start.notes == ()
    assert start.floor == "0"
    assert nav.is_navigable(start.p_m, "0")
    assert 5.0 <= start.shortest_path_m <= 30.0
    assert start.shortest_path_m == pytest.approx(nav.distance_field(goals.viewpoints).at(start.p_m, "0"))
    straight = np.linalg.norm(goals.viewpoints["0"] - np.array(start.p_m[:2]), axis=1).min()
    assert start.shortest_path_m >= 1.05 * straight
    eye = np.array([*start.p_m[:2], 0.88], dtype=np.float32)
    corners = [[(COUCH_LOW, COUCH_HIGH)[i >> k & 1][k] for k in range(3)] for i in range(8)]
    # Rays to points just before the corners, so that the couch itself isn't in the way.
    ends = (np.array(corners) + 0.02 * (eye - corners) / np.linalg.norm(eye - corners, axis=1)[:, None]).astype(
        np.float32
    )
    assert RayCaster(scene).occluded(np.broadcast_to(eye, ends.shape), ends).mean() > 0.7


def test_a_way_that_is_all_but_straight_is_no_start(boxes, room) -> None:
    """A narrow screen hides the plant from places almost straight before it; a closed nook is the honest way."""
    screen = ("wall", "0", (4.0, 1.6, 0.0), (4.1, 2.4, 2.5))
    nook = [("wall", "0", (0.0, 5.0, 0.0), (4.0, 5.1, 2.5)), ("wall", "0", (4.0, 5.0, 0.0), (4.1, 7.2, 2.5))]
    plant = ("potted plant", "0", (10.5, 1.9, 0.0), (10.7, 2.1, 0.8))
    scene = boxes([*room(12.0, 8.0), screen, *nook, plant])
    nav = NavigationMap.build(scene)
    goals = find_goals(scene, nav, "potted plant")
    for seed in range(8):
        start = sample_start(scene, nav, goals, seed=seed)
        straight = np.linalg.norm(goals.viewpoints["0"] - np.array(start.p_m[:2]), axis=1).min()
        assert start.shortest_path_m >= 1.05 * straight
        assert start.notes == ()


def test_over_a_counter_is_in_sight(boxes, room) -> None:
    """A counter of half a metre makes a detour but hides nothing: only the nook behind the wall will do."""
    counter = ("", "0", (6.0, 0.0, 0.0), (6.1, 6.5, 0.5))
    nook = ("wall", "0", (2.0, 0.0, 0.0), (2.1, 6.5, 2.5))
    plant = ("potted plant", "0", (10.5, 1.9, 0.0), (10.7, 2.1, 0.8))
    scene = boxes([*room(12.0, 8.0), counter, nook, plant])
    nav = NavigationMap.build(scene)
    goals = find_goals(scene, nav, "potted plant")
    starts = [sample_start(scene, nav, goals, seed=seed) for seed in range(8)]
    assert all(s.p_m[0] < 2.0 and s.notes == () for s in starts)


def test_starts_follow_the_seed(home) -> None:
    goals = find_goals(*home, "couch")
    starts = [sample_start(*home, goals, seed=s) for s in range(5)]
    assert starts == [sample_start(*home, goals, seed=s) for s in range(5)]
    assert len({s.p_m for s in starts}) == 5
    assert len({s.yaw_rad for s in starts}) == 5
    assert all(-math.pi <= s.yaw_rad <= math.pi for s in starts)


def test_a_small_home_relaxes_the_rules_and_says_so(boxes, room) -> None:
    one_room = boxes([*room(3.0, 3.0), ("bed", "0", (0.1, 0.1, 0.0), (1.0, 2.0, 0.5))])
    nav = NavigationMap.build(one_room)
    goals = find_goals(one_room, nav, "bed")
    start = sample_start(one_room, nav, goals, seed=0)
    assert len(start.notes) == 1
    assert "in sight" in start.notes[0] or "next to" in start.notes[0]
    # Two rooms: hidden, but never five metres away; hiding is worth more than distance.
    wall = ("wall", "0", (2.95, 0.0, 0.0), (3.05, 2.2, 2.5))
    two_rooms = boxes([*room(6.0, 3.0), wall, ("bed", "0", (0.1, 0.1, 0.0), (1.0, 2.0, 0.5))])
    nav = NavigationMap.build(two_rooms)
    goals = find_goals(two_rooms, nav, "bed")
    start = sample_start(two_rooms, nav, goals, seed=0)
    assert start.notes[0].startswith("a shorter way, hidden")
    assert start.p_m[0] > 3.0


def test_starts_stand_on_a_floor_with_a_goal(boxes, room) -> None:
    floors = (Floor("0", "ground", 0.0, 2.5), Floor("1", "upper", 2.7, 2.5))
    stair = Stair("0", "1", (1.0, 1.0, 0.0), (3.0, 1.0, 2.7), 4.0)
    bed = ("bed", "1", (9.0, 0.1, 2.7), (9.9, 2.0, 3.2))
    scene = boxes([*room(10, 4), *room(10, 4, "1", 2.7), bed], floors, (stair,))
    nav = NavigationMap.build(scene)
    goals = find_goals(scene, nav, "bed")
    assert list(goals.viewpoints) == ["1"]
    assert {sample_start(scene, nav, goals, seed=s).floor for s in range(6)} == {"1"}


def test_the_judge_by_table(home) -> None:
    goals = find_goals(*home, "couch")
    # The westernmost viewpoint of the couch's middle lies at x = 8.025 (1 m before it, centres of 5 cm cells).
    west = goals.viewpoints["0"][np.abs(goals.viewpoints["0"][:, 1] - 2.025) < 0.01][:, 0].min()
    assert west == pytest.approx(8.025)

    def verdict(d: float, *, stopped: bool = True, path_m: float = 10.0, shortest_path_m: float = 8.0):
        return judge(
            goals, State((west - d, 2.025, 0.0), path_m=path_m, stopped=stopped), shortest_path_m=shortest_path_m
        )

    at = verdict(0.0)
    assert (at.success, at.spl, at.soft_spl) == (True, pytest.approx(0.8), pytest.approx(0.8))
    assert verdict(0.099).success
    assert not verdict(0.101).success
    assert verdict(0.101).spl == 0.0
    assert verdict(0.199).success_at_0_2_m
    assert not verdict(0.201).success_at_0_2_m
    assert verdict(0.999).success_at_1_m
    assert not verdict(1.001).success_at_1_m
    assert verdict(2.0).distance_to_viewpoint_m == pytest.approx(2.0, abs=1e-3)
    assert verdict(2.0).soft_spl == pytest.approx((1 - 2.0 / 8.0) * 0.8, abs=1e-3)
    assert not verdict(0.0, stopped=False).success
    assert not verdict(0.0, stopped=False).success_at_1_m
    assert verdict(0.0, stopped=False).soft_spl == pytest.approx(0.8)
    assert verdict(0.0, path_m=4.0).spl == 1.0, "shorter than the shortest way (within a cell) is not better than 1"
    assert verdict(0.0, path_m=0.0, shortest_path_m=0.0).spl == 1.0
    off = judge(goals, State((-5.0, 0.0, 0.0), path_m=1.0), shortest_path_m=8.0)
    assert (off.success, off.soft_spl, off.distance_to_viewpoint_m) == (False, 0.0, math.inf)
