"""The upper bound: the shortest way to the nearest goal's viewpoint, stairs included, by a robot's own actions.

No method: it knows the building and where the goals are. It pays for what a robot that turns by twelfths and moves by
whole steps can't avoid, so its SPL is reported, not assumed to be 1.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from surveilnav.benchmark.policies.policy import Policy, Task, Truth
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import Decision, FloorMaps, PlannerConfig, RobotView
from surveilnav.services.planner.core.motion.drive import HEADINGS
from surveilnav.simulator.world.distance_field import Waypoint
from surveilnav.simulator.world.goals import SUCCESS_M

#: Weighted A* (Pohl 1970): at most so much longer than the best sequence of whole steps, and many times faster.
_WEIGHT = 1.05
#: Ends of steps so near to each other are the same place.
_SAME_M = 0.05
_MAX_PLACES = 50_000
_Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Step:
    """A move from one place to the next, facing ``yaw_rad``."""

    start: _Place
    yaw_rad: float
    end: _Place


class ShortestPath:
    """See ``Searcher``. Plans whole steps once for every floor, without a collision, and follows the plan."""

    def __init__(self, task: Task) -> None:
        if task.truth is None:
            raise ValueError("the shortest path needs Task.truth: begin it only where Policy.needs_truth is honoured")
        self._truth: Truth = task.truth
        self._max_steps, self._config = task.max_steps, PlannerConfig()
        self._plan: deque[_Step] = deque()
        self.steps = 0

    def act(self, maps: FloorMaps, robot: RobotView, summaries: Mapping[str, Mapping[str, float]]) -> Decision:
        """The next action; the maps aren't looked at."""
        here = robot.x_m, robot.y_m
        way = self._truth.goals.field.path_from(here, robot.floor)
        if self.steps >= self._max_steps:
            return _failure("out_of_steps", f"{self._max_steps} steps are used up")
        if not way:
            return _failure("unreachable", "no way leads to any goal")
        stair = next(((a, b) for a, b in itertools.pairwise(way) if a.floor != b.floor), None)
        if self._arrived(here, robot.floor, stair):
            return self._stop() if stair is None else self._take(*stair, robot)
        if not self._plan or math.dist(self._plan[0].start, here) > 0.01:
            self._plan = self._planned(robot, stair)
        if not self._plan:
            return _failure("stuck", "no sequence of whole steps leads to any goal")
        self.steps += 1
        off_rad = math.remainder(self._plan[0].yaw_rad - robot.yaw_rad, 2.0 * math.pi)
        path = (here, *(step.end for step in self._plan))
        left_m = sum(math.dist(step.start, step.end) for step in self._plan)
        if abs(off_rad) > self._config.turn_rad / 2:
            action = "turn_left" if off_rad > 0 else "turn_right"
        else:
            action = "move_forward"
            self._plan.popleft()
        return Decision(action, "approaching", f"{left_m:.1f} m to go", path=path, distance_m=left_m)

    def _arrived(self, p: _Place, floor: str, stair: tuple[Waypoint, Waypoint] | None) -> bool:
        """At a viewpoint, or where the stair that leads to one can be taken."""
        if stair is None:
            return self._truth.goals.field.at(p, floor) <= SUCCESS_M
        end = stair[0].x_m, stair[0].y_m
        near = math.dist(p, end) <= self._config.stairs_radius_m
        return near and self._truth.navigation.way_free(p, end, floor) >= 1.0

    def _stop(self) -> Decision:
        self.steps += 1
        return Decision("stop", "finished", "at a viewpoint", finished=True, found=True)

    def _take(self, foot: Waypoint, head: Waypoint, robot: RobotView) -> Decision:
        ends = [s for s in robot.stairs if s.floor == foot.floor and s.to_floor == head.floor]
        stair = min(ends, key=lambda s: math.dist(s.at_m[:2], (foot.x_m, foot.y_m)))
        length_m = math.dist(stair.at_m[:2], (robot.x_m, robot.y_m)) + stair.length_m
        self.steps += max(1, math.ceil(length_m / self._config.step_m - 1e-9))
        return Decision("take_stairs", "changing floor", f"to floor {head.floor}", to_floor=head.floor)

    def _planned(self, robot: RobotView, stair: tuple[Waypoint, Waypoint] | None) -> deque[_Step]:
        """Whole free steps to where the robot has arrived; empty if there are none. A turn costs a little, too."""
        field, config = self._truth.goals.field, self._config
        here = robot.x_m, robot.y_m
        queue: list[tuple[float, int, float, _Place, float]] = [(0.0, 0, 0.0, here, robot.yaw_rad)]
        came: list[tuple[int, _Step]] = []  # which entry of the queue a step was made from
        done: set[tuple[int, int]] = set()
        pushed = 1
        while queue and len(done) < _MAX_PLACES:
            _, entry, spent_m, p, yaw_rad = heapq.heappop(queue)
            cell = round(p[0] / _SAME_M), round(p[1] / _SAME_M)
            if cell in done:
                continue
            done.add(cell)
            if self._arrived(p, robot.floor, stair):
                return _steps_to(entry, came)
            for turns in HEADINGS.tolist():
                facing = yaw_rad + turns * config.turn_rad
                end = p[0] + config.step_m * math.cos(facing), p[1] + config.step_m * math.sin(facing)
                if self._truth.navigation.way_free(p, end, robot.floor) >= 1.0:
                    cost_m = spent_m + config.step_m + config.turn_cost_m * abs(turns)
                    guess_m = cost_m + _WEIGHT * field.at(end, robot.floor)
                    heapq.heappush(queue, (guess_m, pushed, cost_m, end, facing))
                    came.append((entry, _Step(p, facing, end)))
                    pushed += 1
        return deque()


def _steps_to(entry: int, came: list[tuple[int, _Step]]) -> deque[_Step]:
    steps: deque[_Step] = deque()
    while entry:
        entry, step = came[entry - 1]
        steps.appendleft(step)
    return steps


def _failure(error: str, message: str) -> Decision:
    return Decision(None, "finished", message, finished=True, error=error)


SHORTEST_PATH = Policy(
    "shortest-path",
    "no method but the bound: the shortest way to the nearest goal with the same actions",
    ShortestPath,
    FusionConfig(),
    needs_truth=True,
)
