"""A bound, no method: ours, but told which frontier lies on the shortest way to a goal. All else is as ours.

Its gain over ours is what better knowledge of what lies beyond frontiers could bring at most, with the same perception, the same
verification and the same driving. The frontier that it chooses competes with objects by the chance of any wide frontier: it
isn't told whether an object is the target, nor that exploring pays off more than going to an object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from surveilnav.benchmark.policies.mission import MissionPolicy
from surveilnav.benchmark.policies.policy import Policy, Task, Truth
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.options.frontiers import only, rule_of

#: A frontier that lies in something, by the truth, is as far from a goal as the nearest free place within this distance.
_BESIDE_M = 1.0


class PerfectFrontierRule:
    """Chooses the frontier with the shortest way over it to a goal: the way to it, and the true shortest path from there."""

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self._left_m: dict[tuple[str, float, float], float] = {}  # the same frontiers are asked for at every step

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        """See ``FrontierRule``. Where no way leads from any of them to a goal, ours chooses."""
        ways_m = [f.travel_time_m + self.left_m(f.x_m, f.y_m, context.robot.floor) for f in found]
        if not any(map(math.isfinite, ways_m)):
            return rule_of(context.config)(context, found)
        chosen = found[min(range(len(found)), key=ways_m.__getitem__)]
        return only(context, chosen, found, "told by the truth")

    def left_m(self, x_m: float, y_m: float, floor: str) -> float:
        """The shortest path [m] from a place to a viewpoint of a goal; inf: there is none."""
        key = floor, x_m, y_m
        if key not in self._left_m:
            self._left_m[key] = self._path_m(x_m, y_m, floor)
        return self._left_m[key]

    def _path_m(self, x_m: float, y_m: float, floor: str) -> float:
        field, navigation = self._truth.goals.field, self._truth.navigation
        if math.isfinite(path_m := field.at((x_m, y_m), floor)):
            return path_m
        beside = navigation.snap((x_m, y_m), floor, within_m=_BESIDE_M)
        return math.inf if beside is None else math.dist((x_m, y_m), beside[:2]) + field.at(beside, floor)


def _begin(task: Task) -> MissionPolicy:
    if task.truth is None:
        raise ValueError("perfect frontiers need Task.truth: begin them only where Policy.needs_truth is honoured")
    return MissionPolicy(task, PlannerConfig(), PerfectFrontierRule(task.truth), summaries=True)


PERFECT_FRONTIERS = Policy(
    "perfect-frontiers",
    "no method but a bound: ours, told which frontier lies on the shortest way to a goal",
    _begin,
    FusionConfig(),
    needs_truth=True,
)
