"""Robots that drive to waypoints by themselves: where they are sent, when a waypoint is replaced, and what a failed one does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.messages import Candidate, RobotDescription, WaypointPose, WaypointStatus
from surveilnav.robot_frame import PlanarTransform
from surveilnav.services.planner.core import Decision, MissionState, PlannerConfig, RobotView, step
from surveilnav.services.planner.core.memory.waypoint import CurrentWaypoint
from surveilnav.services.planner.core.motion.waypoint_driving import inner_cells, is_decision_due, to_drive

CONFIG = PlannerConfig(drive="waypoints", max_pitch_rad=0.0)
TWO_ROOMS = """
##########################################
#                   #                    #
#                   #                    #
#                   #              CC    #
#                   #              CC    #
#                   #                    #
#                                        #
#                                        #
#                                        #
#                   #                    #
#   R               #                    #
#                   #                    #
##########################################
"""


def robot(x=0.0, y=0.0, yaw=0.0, waypoint=None):
    return RobotView(3, x, y, yaw, 0.0, "0", False, "drive_to", 0.0, waypoint=waypoint)


def driving(id, state="driving", why=""):
    return WaypointStatus(id=id, state=state, why=why)


def to(path, x, y, kind="frontier"):
    """A decision to drive along a path to a waypoint at (x, y)."""
    return Decision("drive_to", "exploring", waypoint=Candidate(kind, x, y, 1.0, True, ""), path=tuple(path))


@pytest.mark.parametrize(("action", "sign"), [("turn_left", 1), ("turn_right", -1)])
@pytest.mark.parametrize("yaw", [0.0, 3.0, -3.0])
def test_a_turn_is_a_pose_on_the_spot(action, sign, yaw):
    pose = to_drive(Decision(action, "scanning"), MissionState("tv"), robot(1.0, 2.0, yaw), CONFIG).waypoint_pose
    assert (pose.x_m, pose.y_m) == (1.0, 2.0)
    assert math.remainder(pose.yaw_rad - yaw, 2 * math.pi) == pytest.approx(sign * CONFIG.turn_rad)


def test_a_way_ends_facing_its_waypoint_or_straight_on():
    path = [(0.0, 0.0), (2.0, 0.0)]
    beside = to_drive(to(path, 2.0, 1.0), MissionState("tv"), robot(), CONFIG).waypoint_pose
    assert (beside.x_m, beside.y_m, beside.yaw_rad) == pytest.approx((2.0, 0.0, math.pi / 2))
    on_it = to_drive(to([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)], 2.0, 2.1), MissionState("tv"), robot(), CONFIG)
    assert on_it.waypoint_pose.yaw_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("end", "state", "stays"),
    [
        ((2.3, 0.0), "driving", True),  # within same_place_m
        ((2.6, 0.0), "driving", False),
        ((2.0, 0.0), "reached", False),  # the robot stopped short of what is wanted
        ((2.0, 0.0), "cancelled", False),
    ],
)
def test_a_waypoint_stays_while_the_robot_drives_and_the_new_one_is_near(end, state, stays):
    memory = MissionState("tv")
    first = to_drive(to([(0.0, 0.0), (2.0, 0.0)], 2.0, 0.0), memory, robot(), CONFIG).waypoint_pose
    memory.record_decision(to([(0.0, 0.0)], 0.0, 0.0))
    here = robot(0.5, 0.0, waypoint=driving(first.id, state))
    second = to_drive(to([(0.5, 0.0), end], *end), memory, here, CONFIG).waypoint_pose
    assert (second == first) == stays
    assert stays or second.id != first.id


def test_stopping_and_failing_need_no_waypoint():
    for decision in (Decision("stop", "finished", finished=True, found=True), Decision(None, "finished")):
        assert to_drive(decision, MissionState("tv"), robot(), CONFIG) is decision


@given(st.integers(0, 1000), st.floats(0.5, 6.0))
def test_inner_cells_are_goals_away_from_the_rim_and_never_none(seed, tolerance):
    goals = np.random.default_rng(seed).random((20, 20)) < 0.7
    goals[5:15, 5:15] = True
    inner = inner_cells(goals, tolerance)
    assert inner.any()
    assert (goals | ~inner).all()
    outside = np.argwhere(~np.pad(goals, 1)) - 1
    depth = [np.linalg.norm(outside - cell, axis=1).min() for cell in np.argwhere(inner)]
    deepest = max(np.linalg.norm(outside - cell, axis=1).min() for cell in np.argwhere(goals))
    assert min(depth) >= min(tolerance, deepest) - 0.35  # OpenCV's distances are approximate


def test_a_failed_way_is_blacklisted_with_its_reason():
    memory = MissionState("tv", floor="0")
    memory.waypoint = CurrentWaypoint("target", 2.0, 0.0, None, 0)
    memory.record_drive(WaypointPose(id="7", x_m=2.0, y_m=0.0, yaw_rad=0.0), is_turn=False)
    memory.record_robot(robot(waypoint=driving("7", "failed", "no path")), CONFIG)
    assert memory.is_blacklisted(2.0, 0.0, CONFIG)
    assert memory.waypoint is None
    assert (memory.failed_drives, memory.failed_drive_why) == (1, "no path")
    assert memory.unreachable_why.endswith("but the robot can't drive there: no path")
    memory.record_robot(robot(waypoint=driving("7", "failed", "no path")), CONFIG)
    assert memory.failed_drives == 1, "it is told once"


@pytest.mark.parametrize(
    ("id", "is_turn", "state"), [("6", False, "failed"), ("7", True, "failed"), ("7", False, "reached")]
)
def test_what_ends_otherwise_is_no_failure(id, is_turn, state):
    memory = MissionState("tv", floor="0")
    memory.waypoint = CurrentWaypoint("frontier", 2.0, 0.0, None, 0)
    memory.record_drive(WaypointPose(id="7", x_m=2.0, y_m=0.0, yaw_rad=0.0), is_turn=is_turn)
    memory.record_robot(robot(waypoint=driving(id, state)), CONFIG)
    assert memory.waypoint is not None
    assert memory.failed_drives == 0


AT = WaypointPose(id="1", x_m=3.0, y_m=0.0, yaw_rad=0.0)
TURN = WaypointPose(id="1", x_m=0.0, y_m=0.0, yaw_rad=1.0)


@pytest.mark.parametrize(
    ("waypoint", "status", "moved", "elapsed_s", "due"),
    [
        (AT, driving("1"), (0.1, 0.1), 0.5, False),
        (AT, driving("1"), (0.26, 0.0), 0.5, True),
        (AT, driving("1"), (0.0, 0.6), 0.5, True),
        (AT, driving("1"), (0.0, 0.0), 1.0, True),
        (AT, driving("1", "failed"), (0.0, 0.0), 0.1, True),
        (AT, driving("0"), (0.0, 0.0), 0.1, True),  # another command replaced it
        (AT, None, (0.0, 0.0), 0.1, True),  # the robot was restarted
        (TURN, driving("1"), (0.0, 0.6), 3.0, False),  # a turn is waited for
        (TURN, driving("1", "reached"), (0.0, 1.0), 3.0, True),
        (TURN, driving("1"), (0.0, 0.0), 15.0, True),
    ],
)
def test_when_the_next_decision_is_due(waypoint, status, moved, elapsed_s, due):
    now = PlanarTransform(moved[0], 0.0, moved[1])
    assert is_decision_due(waypoint, status, PlanarTransform(), now, elapsed_s, 1.0, CONFIG) == due


def test_a_robots_description_replaces_habitats_robot_and_nothing_else():
    own = PlannerConfig(robot_radius_m=0.3, camera_height_m=1.5)
    assert own.for_robot(RobotDescription()) == own
    config = own.for_robot(RobotDescription(drive="waypoints", radius_m=0.25, hfov_rad=1.0, max_pitch_rad=0.0))
    assert (config.drive, config.robot_radius_m, config.camera_height_m) == ("waypoints", 0.25, 1.5)
    assert (config.half_fov_rad, config.max_pitch_rad) == (pytest.approx(0.47), 0.0)


class Nav2:
    """Drives in the flat world: straight along the plan's path, as far as a decision lets it, and stops short of the end."""

    def __init__(self, world, short_m=0.2, fails=lambda pose: ""):
        self.world, self.short_m, self.fails = world, short_m, fails
        self.status, self.sent = None, []

    def drive(self, decision):
        world, pose = self.world, decision.waypoint_pose
        if self.status is None or self.status.id != pose.id:
            self.sent.append(pose)
        if why := self.fails(pose):
            self.status = driving(pose.id, "failed", why)
            return
        left_m, path = 0.25, list(decision.path)
        for x, y in path[1:]:
            gap_m = math.dist((x, y), (world.x, world.y))
            if math.dist((pose.x_m, pose.y_m), (world.x, world.y)) <= self.short_m or left_m <= 0.0:
                break
            share = min(1.0, left_m / max(gap_m, 1e-9))
            world.yaw = math.atan2(y - world.y, x - world.x)
            world.x, world.y = world.x + share * (x - world.x), world.y + share * (y - world.y)
            left_m -= gap_m
            world.path_m += min(gap_m, 0.25)
            world.look()
        reached = math.dist((pose.x_m, pose.y_m), (world.x, world.y)) <= self.short_m
        if reached:
            world.yaw = pose.yaw_rad
        self.status = driving(pose.id, "reached" if reached else "driving")
        world.trace.append((world.x, world.y))


def search(world, nav2, max_steps=250):
    state, decisions = MissionState("chair", max_steps=max_steps), []
    while True:
        view = replace(world.robot(), waypoint=nav2.status, last_action="drive_to", collided=False)
        state, decision = step(state, world.maps(), view, CONFIG)
        decisions.append(decision)
        if decision.finished:
            return state, decisions
        assert decision.action == "drive_to"
        nav2.drive(decision)
        world.seq += 1
        world.look()


def test_a_whole_search_drives_to_few_waypoints_and_stops_near(world, thing):
    w = world(TWO_ROOMS, {"C": thing("chair", looks_like="chair")}, yaw_rad=math.pi)
    nav2 = Nav2(w)
    _, decisions = search(w, nav2)
    assert decisions[-1].found
    assert w.gap_m("C") <= 1.1
    drives = [d for d in decisions if d.path and len(d.path) > 1]
    turns = len(decisions) - len(drives)
    assert len(nav2.sent) - turns < len(drives) / 2, "most decisions leave the waypoint as it is"


def test_a_robot_that_drives_nowhere_ends_with_the_reason_of_its_own_navigation(world, thing):
    w = world(TWO_ROOMS, {"C": thing("chair", looks_like="chair")}, yaw_rad=math.pi)
    here = w.x, w.y

    def fails(pose):
        return "" if math.dist((pose.x_m, pose.y_m), here) < 0.01 else "planner failed to make a plan"

    _, decisions = search(w, Nav2(w, fails=fails))
    assert not decisions[-1].found
    assert decisions[-1].error in ("stuck", "not_found")
    assert decisions[-1].error == "stuck" or "planner failed to make a plan" in decisions[-1].message
