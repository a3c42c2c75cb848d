"""Random walk and random samples: the lower bounds of the field's tables.

Both look around at the start, go to a random place that a way leads to, and on to the next: within 1 m for the walk,
anywhere for the samples. A target in sight is gone to and verified as ours is, or nothing would ever be found.
They never finish with a floor, so they stay on the one where they began.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surveilnav.benchmark.policies.mission import MissionPolicy
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.options.frontiers import only

_WALK_M = 1.0


class RandomPlaceRule:
    """Draws the next place when the last one was reached or given up."""

    def __init__(self, seed: int, within_m: float) -> None:
        self._rng, self._within_m = np.random.default_rng(seed), within_m

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        """See ``FrontierRule``: places stand in for frontiers."""
        waypoint, time_m = context.state.waypoint, context.travel_time_m
        if waypoint is not None and waypoint.kind == "frontier":
            cell = context.terrain.cell(waypoint.x_m, waypoint.y_m)
            place = Frontier(waypoint.x_m, waypoint.y_m, 1, float(time_m[cell]))
        else:
            place = self._draw(context)
        return only(context, place, [place], "at random")

    def _draw(self, context: StepContext) -> Frontier:
        terrain, robot, config, time_m = context.terrain, context.robot, context.config, context.travel_time_m
        places = np.isfinite(time_m) & terrain.known & (terrain.speed > config.constrained_speed)
        places &= ~terrain.disc(robot.x_m, robot.y_m, config.reached_m)
        if math.isfinite(self._within_m):
            places &= terrain.disc(robot.x_m, robot.y_m, self._within_m)
        cells = np.argwhere(places)
        if not len(cells):
            cells = np.argwhere(np.isfinite(time_m))
        row, col = (int(v) for v in cells[self._rng.integers(len(cells))])
        return Frontier(*terrain.centre_of(row, col), 1, float(time_m[row, col]))


RANDOM_WALK = Policy(
    "random-walk",
    "to a random place within a metre, and on",
    lambda task: MissionPolicy(task, PlannerConfig(choice="paper"), RandomPlaceRule(task.seed, _WALK_M)),
    FusionConfig(),
)
RANDOM_SAMPLES = Policy(
    "random-samples",
    "to a random place anywhere, and on",
    lambda task: MissionPolicy(task, PlannerConfig(choice="paper"), RandomPlaceRule(task.seed, math.inf)),
    FusionConfig(),
)
