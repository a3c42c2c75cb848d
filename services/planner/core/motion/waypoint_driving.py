"""Planning for a robot that drives to waypoints by itself: where it is to drive, and when a new waypoint replaces the old one.

The choice is made as it is for a robot of discrete actions. Here a route becomes the pose at its end, and a turn becomes a pose
on the spot. The robot's own navigation (such as Nav2) finds the way, and is in charge of collisions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import WaypointPose, WaypointStatus
from surveilnav.robot_body import clearance_m
from surveilnav.robot_frame import PlanarTransform
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.inputs import RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.drive import BEYOND_ROBOT_M, Route, descend
from surveilnav.services.planner.core.motion.terrain import Terrain, lines_are_clear, travel_time_m

_TURNS = {"turn_left": 1.0, "turn_right": -1.0}


class WaypointPlanner:
    """A ``LocalPlanner`` for robots that find their way themselves: it only tells where a way ends, and how long it takes."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig
    ) -> Route | None:
        """See ``LocalPlanner``. The way ends inside the goal region rather than at its rim, since robots stop short of a pose."""
        inner = inner_cells(goals, config.waypoint_tolerance_m / terrain.grid.resolution_m)
        here = terrain.cell(robot.x_m, robot.y_m)
        for cells in (inner, goals):
            field = travel_time_m(terrain.speed, cells, terrain.grid.resolution_m, [[here]], BEYOND_ROBOT_M)
            if math.isfinite(field[here]):
                path = before_barred(terrain, descend(terrain, field, *here), robot)
                return Route("drive_to", path, float(field[here]))
        return None


def before_barred(
    terrain: Terrain, path: tuple[tuple[float, float], ...], robot: RobotView
) -> tuple[tuple[float, float], ...]:
    """The beginning of a path (x, y) [m] whose end the robot can be sent to although its own navigation doesn't know where it
    mustn't go: the whole path if that passes no barred area, else a short piece that a straight line clear of such areas joins.
    """
    barred, others = terrain.barred, terrain.speed_of_others
    if barred is None or others is None:
        return path
    here, r = terrain.cell(robot.x_m, robot.y_m), terrain.grid.resolution_m
    end = np.zeros(terrain.grid.shape, dtype=bool)
    end[terrain.cell(*path[-1])] = True
    own_way = descend(terrain, travel_time_m(others, end, r, [[here]], BEYOND_ROBOT_M), *here)
    cells = terrain.grid.cells_of(np.array(own_way))
    if clearance_m(barred.near, r)[cells[:, 0], cells[:, 1]].min() > _NEAR_M:
        return path
    points = terrain.grid.cells_of(np.array(path))
    clear = lines_are_clear(barred.near | terrain.occupied, points, np.full(points.shape, here), _OUT_OF_RIM_M / r)
    within = np.linalg.norm(np.array(path) - path[0], axis=1) <= _PIECE_M
    # inside an area no line is clear, and a piece that is too short counts as reached before the robot has moved
    usable = within if terrain.must_leave else within & clear
    last = max(1, int(np.flatnonzero(usable).max(initial=1)))
    return path[: last + 1]


#: Navigation that would pass an area at this distance might as well pass through it, since it weighs distances otherwise.
_NEAR_M = 0.3
#: Beside an area the robot is sent no farther than this at a time, so that its navigation keeps to about the straight line.
_PIECE_M = 1.0
#: A robot that stands so far inside the rim of a barred area drives straight out of it.
_OUT_OF_RIM_M = 0.4


def inner_cells(goals: NDArray[np.bool_], tolerance_cells: float) -> NDArray[np.bool_]:
    """(rows, cols) the goal cells that are farther than a tolerance from the region's rim; of a narrow region, the innermost."""
    depth = cv2.distanceTransform(np.pad(goals, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(goals & (depth >= min(tolerance_cells, float(depth.max()))))


def to_drive(
    decision: Decision,
    state: MissionState,
    robot: RobotView,
    config: PlannerConfig,
    leads_through_barred: Callable[[float, float], bool] = lambda x_m, y_m: False,
) -> Decision:
    """The decision as a waypoint that the robot drives to, if it is about moving; ``state`` remembers the waypoint.

    While the robot drives, its waypoint stays unless the new one is clearly elsewhere, since each replacement makes it slow down,
    or unless ``leads_through_barred``: on the straight line to a place (x, y) there is one where no robot is sent.
    """
    if decision.action in _TURNS:
        yaw_rad = math.remainder(robot.yaw_rad + _TURNS[decision.action] * config.turn_rad, 2 * math.pi)
        wanted = WaypointPose(id=_next_id(state), x_m=robot.x_m, y_m=robot.y_m, yaw_rad=yaw_rad)
    elif decision.action == "drive_to":
        wanted = _end_of(decision, state, robot)
        current = state.driving_to
        keeps = current is not None and _is_driving(current, robot) and _is_near(current, wanted, config)
        if current is not None and keeps and not leads_through_barred(current.x_m, current.y_m):
            wanted = current
    else:
        return decision
    state.record_drive(wanted, is_turn=decision.action in _TURNS)
    return replace(decision, action="drive_to", waypoint_pose=wanted)


#: A turn on the spot ends before the next decision, unless it takes longer than this.
_TURN_TIMEOUT_S = 15.0


def is_decision_due(
    waypoint: WaypointPose,
    status: WaypointStatus | None,
    began: PlanarTransform,
    now: PlanarTransform,
    elapsed_s: float,
    period_s: float,
    config: PlannerConfig,
) -> bool:
    """Whether to decide again while a robot drives: when the drive has ended, when the robot has got as far as by one discrete
    action, or after ``period_s``. So a step of a mission means about the same as for a robot of actions.

    A turn on the spot is waited for, since what it shows is needed for the next decision.

    Args:
        began, now: the robot's pose at the last decision and now, in one frame; ``elapsed_s``: the time between.
    """
    if status is None or status.id != waypoint.id or status.state != "driving":
        return True
    if math.hypot(waypoint.x_m - began.x_m, waypoint.y_m - began.y_m) < config.step_m / 2:
        return elapsed_s >= _TURN_TIMEOUT_S
    moved_m, turned_rad = began.difference(now)
    return elapsed_s >= period_s or moved_m >= config.step_m or turned_rad >= config.turn_rad


def _end_of(decision: Decision, state: MissionState, robot: RobotView) -> WaypointPose:
    """The end of the decision's path. The robot looks at what it drives to or, if it drives right onto that, straight on."""
    end = decision.path[-1]
    before = next((p for p in reversed(decision.path) if math.dist(p, end) > _STRAIGHT_M), (robot.x_m, robot.y_m))
    target = decision.waypoint
    if target is not None and math.dist((target.x_m, target.y_m), end) > _STRAIGHT_M:
        before, ahead = end, (target.x_m, target.y_m)
    else:
        ahead = end
    yaw_rad = math.atan2(ahead[1] - before[1], ahead[0] - before[0])
    return WaypointPose(id=_next_id(state), x_m=end[0], y_m=end[1], yaw_rad=yaw_rad)


#: Directions are measured between places that are at least so far apart.
_STRAIGHT_M = 0.3


def _is_driving(current: WaypointPose, robot: RobotView) -> bool:
    return robot.waypoint is not None and robot.waypoint.id == current.id and robot.waypoint.state == "driving"


def _is_near(current: WaypointPose, wanted: WaypointPose, config: PlannerConfig) -> bool:
    return math.hypot(current.x_m - wanted.x_m, current.y_m - wanted.y_m) <= config.same_place_m


def _next_id(state: MissionState) -> str:
    return str(state.step)
