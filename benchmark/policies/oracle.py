"""The upper bound: the shortest way to the nearest goal's viewpoint, stairs included, by a robot's own actions.

No method: it knows the building and where the goals are. It pays for what a robot that turns by twelfths and moves by
whole steps can't avoid, so its SPL is reported, not assumed to be 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from benchmark.policies.policy import Policy, Task, Truth
from services.fusion.core import FusionConfig
from services.planner.core import Decision, MapView, PlannerConfig, RobotView
from services.planner.core.drive import HEADINGS
from surveilnav.building.goals import SUCCESS_M

#: So near to the goal all sequences of steps up to this number are tried: it must be met within ``SUCCESS_M``.
_NEAR_M, _NEAR_STEPS, _FAR_STEPS = 1.0, 3, 2
#: As fine as makes no difference to where a step ends.
_Place = tuple[float, float]


class Oracle:
    """See ``Searcher``."""

    def __init__(self, task: Task) -> None:
        if task.truth is None:
            raise ValueError("the oracle needs Task.truth: begin it only where Policy.needs_truth is honoured")
        self._truth: Truth = task.truth
        self._max_steps, self._config = task.max_steps, PlannerConfig()
        self.steps = 0

    def act(self, maps: MapView, robot: RobotView, summaries: Mapping[str, Mapping[str, float]]) -> Decision:
        """The next action; the maps aren't looked at."""
        field, here = self._truth.goals.field, (robot.x_m, robot.y_m)
        left_m = field.at(here, robot.floor)
        if self.steps >= self._max_steps:
            return _failure("out_of_steps", f"{self._max_steps} steps are used up")
        if math.isinf(left_m):
            return _failure("unreachable", "no way leads to any goal")
        if left_m <= SUCCESS_M:
            self.steps += 1
            return Decision("stop", "finished", f"{left_m:.2f} m from a viewpoint", finished=True, found=True)
        way = field.path_from(here, robot.floor)
        path = tuple((w.x_m, w.y_m) for w in way if w.floor == robot.floor)
        following = next((w for w in way if w.floor != robot.floor), None)
        if following is not None and self._at_stairs(path[-1], robot):
            return self._over_stairs(path[-1], following.floor, robot)
        self.steps += 1
        return Decision(
            self._turn_or_move(robot, left_m), "approaching", f"{left_m:.1f} m", path=path, distance_m=left_m
        )

    def _at_stairs(self, end: _Place, robot: RobotView) -> bool:
        here = robot.x_m, robot.y_m
        reached = math.dist(end, here) <= self._config.stairs_reach_m
        return reached and self._truth.navigation.way_free(here, end, robot.floor) >= 1.0

    def _over_stairs(self, end: _Place, to_floor: str, robot: RobotView) -> Decision:
        stairs = [s for s in robot.stairs if s.floor == robot.floor and s.to_floor == to_floor]
        length_m = min((s.length_m for s in stairs if math.dist(s.at_m[:2], end) < 0.1), default=0.0)
        away_m = math.dist(end, (robot.x_m, robot.y_m))
        self.steps += max(1, math.ceil((away_m + length_m) / self._config.step_m - 1e-9))
        return Decision("take_stairs", "changing floor", f"to floor {to_floor}", to_floor=to_floor)

    def _turn_or_move(self, robot: RobotView, left_m: float) -> str:
        """Towards the heading that begins the best few steps; the least blocked one where no step is free."""
        here, n_steps = (robot.x_m, robot.y_m), _NEAR_STEPS if left_m <= _NEAR_M else _FAR_STEPS
        _, turns = self._best(here, robot.yaw_rad, n_steps, robot.floor, math.inf)
        if turns is None:
            turns = max(HEADINGS.tolist(), key=lambda n: (self._free(here, robot.yaw_rad, n, robot.floor), -abs(n)))
        return "move_forward" if turns == 0 else "turn_left" if turns > 0 else "turn_right"

    def _best(self, p: _Place, yaw_rad: float, n_steps: int, floor: str, limit_m: float) -> tuple[float, int | None]:
        """Way [m] to the goal by the best ``n_steps`` free steps, and the turns before the first.

        No step brings the goal nearer than by its length, so whatever can't be shorter than ``limit_m`` isn't tried.
        """
        options = []
        for turns in HEADINGS.tolist():
            if self._free(p, yaw_rad, turns, floor) >= 1.0:
                there = self._step(p, yaw_rad, turns)
                left_m = self._truth.goals.field.at(there, floor)
                spent_m = self._config.step_m + self._config.turn_cost_m * abs(turns)
                options.append((spent_m + max(0.0, left_m - SUCCESS_M), abs(turns), turns, there, left_m, spent_m))
        best_m, first = limit_m, None
        for least_m, _, turns, there, left_m, spent_m in sorted(options):
            if least_m >= best_m:
                break
            if left_m > SUCCESS_M and n_steps > 1:
                heading_rad = yaw_rad + turns * self._config.turn_rad
                left_m, _ = self._best(there, heading_rad, n_steps - 1, floor, best_m - spent_m)
            cost_m = spent_m + (left_m if left_m > SUCCESS_M else 0.0)
            if cost_m < best_m:
                best_m, first = cost_m, turns
        return best_m, first

    def _free(self, p: _Place, yaw_rad: float, turns: int, floor: str) -> float:
        return self._truth.navigation.way_free(p, self._step(p, yaw_rad, turns), floor)

    def _step(self, p: _Place, yaw_rad: float, turns: int) -> _Place:
        yaw_rad += turns * self._config.turn_rad
        return p[0] + self._config.step_m * math.cos(yaw_rad), p[1] + self._config.step_m * math.sin(yaw_rad)


def _failure(error: str, message: str) -> Decision:
    return Decision(None, "finished", message, finished=True, error=error)


ORACLE = Policy(
    "oracle",
    "no method but the bound: the shortest way to the nearest goal with the same actions",
    Oracle,
    FusionConfig(),
    needs_truth=True,
)
