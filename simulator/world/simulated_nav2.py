"""A stand-in for Nav2: has a simulated robot drive to a pose in its map, and ends as Nav2's ``NavigateToPose`` does.

Obstacles are where they are in truth, since a robot sees them; the goal is where the robot's localisation puts it. So a wrong
localisation doesn't drive the robot into walls, but to a wrong place.

Follows Nav2's defaults where it has some: a new goal ends the current one as aborted, a goal in an obstacle counts as the nearest
free place within the planner's tolerance, no movement for 10 s ends the goal.
Source: https://docs.nav2.org/configuration/index.html.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from surveilnav.robot_frame import PlanarTransform
from surveilnav.simulator.world.clear_paths import ClearPaths
from surveilnav.simulator.world.continuous_robot import ContinuousRobot

NavigationStatus = Literal["executing", "succeeded", "canceled", "aborted"]
Place = tuple[float, float]

#: Time between two velocity commands.
_CONTROL_S = 0.05
#: The robot looks this far ahead on its way, and turns on the spot if it must turn by more than this to face what it sees there.
_LOOK_AHEAD_M = 0.35
_TURN_ON_THE_SPOT_RAD = 0.6
#: After a contact it faces the way this exactly, and drives this slowly, for so long.
_CAREFUL_RAD, _CAREFUL_M_S, _CAREFUL_S = 0.05, 0.1, 2.0
#: Turn rate for each radian that it is off.
_TURN_GAIN = 2.5
#: The way is planned anew if the goal has moved by more than this, plus this share of the way that is left.
_GOAL_MOVED_M, _GOAL_MOVED_SHARE = 0.05, 0.03
#: A robot that has moved by this much, or turned, makes progress. Without progress it first tries a recovery, every so often.
_PROGRESS_M, _PROGRESS_RAD, _RECOVERY_S = 0.1, 0.5, 3.0


@dataclass(frozen=True, slots=True)
class NavigationSettings:
    """When a goal is reached or given up.

    Attributes:
        reached_m, reached_rad: by its own estimate the robot is this near to its goal, and faces this nearly in its direction.
        tolerance_m: a goal that isn't free ground counts as the nearest free place within this distance.
        patience_s: without progress for so long, the goal is aborted.
    """

    reached_m: float = 0.15
    reached_rad: float = 0.15
    tolerance_m: float = 0.5
    patience_s: float = 10.0


@dataclass(eq=False)
class NavigationGoal:
    """A goal, and how far it has come.

    Attributes:
        pose: in the robot's map.
        why: if it was aborted or canceled, a sentence for people.
        distance_remaining_m: along the planned way.
        recoveries: how often the robot had to free itself.
        elapsed_s: since it was sent, until it ended.
    """

    pose: PlanarTransform
    status: NavigationStatus = "executing"
    why: str = ""
    distance_remaining_m: float = 0.0
    recoveries: int = 0
    elapsed_s: float = 0.0


class SimulatedNav2:
    """Navigates one robot. ``goal``: the newest, whether it is over or not; None before the first."""

    def __init__(self, robot: ContinuousRobot, settings: NavigationSettings | None = None) -> None:
        self.robot, self.settings = robot, settings or NavigationSettings()
        self.goal: NavigationGoal | None = None
        self._paths: dict[str, ClearPaths] = {}
        self._way: list[Place] = []
        self._planned_for: Place = (0.0, 0.0)
        self._snapped_by = (0.0, 0.0)
        self._careful_until_s = -math.inf
        self._progress_s = self._recovered_s = 0.0
        self._progress_at = PlanarTransform()

    def send(self, pose: PlanarTransform) -> NavigationGoal:
        """Starts to drive to a pose in the robot's map. A goal that is being driven to ends as aborted."""
        if self.goal is not None:
            self._end_goal(self.goal, "aborted", "a newer goal replaced it")
        self.goal = NavigationGoal(pose)
        self._way = []
        self._record_progress()
        return self.goal

    def cancel(self, goal: NavigationGoal) -> bool:
        """Gives up a goal, and brakes. Returns whether it was still being driven to."""
        return self._end_goal(goal, "canceled", "canceled")

    def abort(self, goal: NavigationGoal, why: str) -> bool:
        """Gives up a goal for a reason of its own. Returns whether it was still being driven to."""
        return self._end_goal(goal, "aborted", why)

    def advance(self, dt_s: float) -> None:
        """Lets time pass: commands the robot, and moves it."""
        left_s = dt_s
        while left_s > 1e-9:
            step_s = min(left_s, _CONTROL_S)
            if self.goal is not None and self.goal.status == "executing":
                self.goal.elapsed_s += step_s
                self._control(self.goal)
            self.robot.advance(step_s)
            left_s -= step_s

    # --- a goal ---------------------------------------------------------------------------------------------------

    def _control(self, goal: NavigationGoal) -> None:
        """One velocity command, or the end of the goal."""
        robot = self.robot
        if robot.localisation.lost:
            self._end_goal(goal, "aborted", "the robot has lost its localisation")
            return
        target, yaw_error_rad = self._target(goal.pose)
        if not self._way_leads_to(target) and not self._plan(goal, target):
            self._end_goal(goal, "aborted", f"no path to ({goal.pose.x_m:.2f}, {goal.pose.y_m:.2f})")
            return
        here = robot.pose
        if not self._makes_progress(goal, here):
            return
        end = target[0] + self._snapped_by[0], target[1] + self._snapped_by[1]
        away_m = math.hypot(end[0] - here.x_m, end[1] - here.y_m)
        if away_m > self.settings.reached_m:
            self._follow(goal, here)
            return
        goal.distance_remaining_m = away_m
        if abs(yaw_error_rad) > self.settings.reached_rad:
            robot.command(0.0, _TURN_GAIN * yaw_error_rad)
        else:
            self._end_goal(goal, "succeeded", "")

    def _end_goal(self, goal: NavigationGoal, status: NavigationStatus, why: str) -> bool:
        if goal.status != "executing":
            return False
        goal.status, goal.why = status, why
        self.robot.command(0.0, 0.0)
        return True

    def _target(self, pose: PlanarTransform) -> tuple[Place, float]:
        """Where in the building the goal lies, if the robot is where it believes to be, and by how much it must turn there."""
        here, believed = self.robot.pose, self.robot.localisation.pose
        turn = here.yaw_rad - believed.yaw_rad
        dx, dy, c, s = pose.x_m - believed.x_m, pose.y_m - believed.y_m, math.cos(turn), math.sin(turn)
        yaw_error_rad = math.remainder(pose.yaw_rad - believed.yaw_rad, 2 * math.pi)
        return (here.x_m + c * dx - s * dy, here.y_m + s * dx + c * dy), yaw_error_rad

    # --- the way --------------------------------------------------------------------------------------------------

    def _way_leads_to(self, target: Place) -> bool:
        """Whether the planned way still ends near enough to where the goal is believed to lie."""
        if not self._way or self.goal is None:
            return False
        moved_m = math.hypot(target[0] - self._planned_for[0], target[1] - self._planned_for[1])
        return moved_m <= _GOAL_MOVED_M + _GOAL_MOVED_SHARE * self.goal.distance_remaining_m

    def _plan(self, goal: NavigationGoal, target: Place) -> bool:
        """Plans a way; returns whether there is one."""
        robot = self.robot
        if robot.floor not in self._paths:
            self._paths[robot.floor] = ClearPaths(robot.navigation.floors[robot.floor])
        paths, here = self._paths[robot.floor], (robot.pose.x_m, robot.pose.y_m)
        end = paths.nearest(target, here, self.settings.tolerance_m)
        self._way = paths.path(here, end) if end is not None else []
        if not self._way or end is None:
            return False
        self._planned_for, self._snapped_by = target, (end[0] - target[0], end[1] - target[1])
        goal.distance_remaining_m = _length_m(self._way)
        return True

    def _follow(self, goal: NavigationGoal, here: PlanarTransform) -> None:
        """Drives towards the farthest visible point of the way that is near enough: pure pursuit (Coulter 1992)."""
        robot, limits = self.robot, self.robot.limits
        if robot.collided:
            self._careful_until_s = robot.time_s + _CAREFUL_S
        careful = robot.time_s < self._careful_until_s
        carrot, goal.distance_remaining_m = self._look_ahead(here)
        dx, dy = carrot[0] - here.x_m, carrot[1] - here.y_m
        error_rad = math.remainder(math.atan2(dy, dx) - here.yaw_rad, 2 * math.pi)
        if abs(error_rad) > (_CAREFUL_RAD if careful else _TURN_ON_THE_SPOT_RAD):
            robot.command(0.0, _TURN_GAIN * error_rad)
            return
        away_m = max(math.hypot(dx, dy), 0.05)
        curvature = 2.0 * math.sin(error_rad) / away_m
        speed = limits.speed_m_s * math.cos(error_rad) ** 2
        speed = min(speed, math.sqrt(limits.acceleration_m_s2 * max(goal.distance_remaining_m, 0.01)))
        speed = min(speed, limits.turn_rate_rad_s / max(abs(curvature), 1e-6))
        if careful:
            speed = min(speed, _CAREFUL_M_S)
        robot.command(speed, speed * curvature)

    def _look_ahead(self, here: PlanarTransform) -> tuple[Place, float]:
        """A point of the way that the robot can drive to straight, and the length of the way that is left.

        What lies behind is removed from the way.
        """
        at, way = (here.x_m, here.y_m), self._way
        share = _nearest_share(at, way[0], way[1])
        while share >= 1.0 and len(way) > 2:
            del way[0]
            share = _nearest_share(at, way[0], way[1])
        way[0] = _between(way[0], way[1], share)
        ahead_m = _LOOK_AHEAD_M
        for _ in range(4):
            carrot = _point_along(way, ahead_m)
            if self.robot.navigation.way_free(at, carrot, self.robot.floor) >= 1.0:
                break
            ahead_m /= 2
        return carrot, _length_m(way)

    # --- progress -------------------------------------------------------------------------------------------------

    def _makes_progress(self, goal: NavigationGoal, here: PlanarTransform) -> bool:
        """Plans anew if the robot makes none for a while, and aborts the goal if that doesn't help."""
        before, now_s = self._progress_at, self.robot.time_s
        if (
            math.hypot(here.x_m - before.x_m, here.y_m - before.y_m) >= _PROGRESS_M
            or abs(math.remainder(here.yaw_rad - before.yaw_rad, 2 * math.pi)) >= _PROGRESS_RAD
        ):
            self._record_progress()
        elif now_s - self._progress_s >= self.settings.patience_s:
            self._end_goal(goal, "aborted", f"no progress for {self.settings.patience_s:g} s")
            return False
        elif now_s - self._recovered_s >= _RECOVERY_S:
            self._recovered_s = now_s
            goal.recoveries += 1
            self._plan(goal, self._target(goal.pose)[0])
        return True

    def _record_progress(self) -> None:
        self._progress_s = self._recovered_s = self.robot.time_s
        self._progress_at = self.robot.pose


def _nearest_share(p: Place, a: Place, b: Place) -> float:
    """Where on the line from a to b the point nearest to p is: 0 at a, 1 at b."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    return 1.0 if squared < 1e-12 else max(0.0, min(1.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / squared))


def _between(a: Place, b: Place, share: float) -> Place:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _point_along(way: Sequence[Place], distance_m: float) -> Place:
    """The point of a way this far from its beginning, or its end."""
    for a, b in pairwise(way):
        length_m = math.hypot(b[0] - a[0], b[1] - a[1])
        if distance_m <= length_m:
            return _between(a, b, distance_m / max(length_m, 1e-12))
        distance_m -= length_m
    return way[-1]


def _length_m(way: Sequence[Place]) -> float:
    return sum(math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(way))
