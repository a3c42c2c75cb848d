"""ApexNav's adaptive rule (Zhang et al. 2025, https://arxiv.org/abs/2504.14478): values where they mean something.

Kept: when the standard deviation of the frontiers' values exceeds 0.015 and their max/mean 1.10, a tour over those
within 5 % of the highest (the open travelling salesman from the robot, by driving distance), else the nearest;
frontiers given up without progress left left alone; confidence over all evidence with views that should have shown the
object and didn't counting against it; suspected objects visited only when no frontier is left, or the steps run out.
Not kept: the language model's lists of similar objects (the detectors' other classes stand in), BLIP-2 (values come
from the backend's own embeddings), the LKH solver (the few frontiers of a tour are tried in every order).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.policies.mission import MissionPolicy
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontier_access import current_frontier
from surveilnav.services.planner.core.goals.frontiers import Frontier, rank
from surveilnav.services.planner.core.motion.terrain import coarse_travel_time_m
from surveilnav.services.planner.core.options.frontiers import only

#: No object is promising before it is confirmed: suspected ones come after the frontiers.
CONFIG = PlannerConfig(strategy="region", verification="paper", choice="paper", promising_chance=None)

_NEAR_THE_BEST = 0.95
#: The nearest frontier is left for one that is nearer by this.
_MARGIN_M = 1.0
#: All orders of so many frontiers are tried; of more, the nearest.
_MAX_TOUR = 6


def rate(context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
    config = context.config
    if not found:
        return []
    ranked, exploit = rank(found, context.maps, context.state.target, config)
    if exploit:
        good = good_ones(ranked, config)
        first = first_of_tour(good, _ways(context, good))
        return only(context, first, good, f"first of a tour over {len(good)} by value")
    nearest = min(ranked, key=lambda f: f.travel_time_m)
    current = current_frontier(context, ranked, 1.5 * config.same_place_m)
    if current is not None and current.travel_time_m <= nearest.travel_time_m + _MARGIN_M:
        nearest = current
    return only(context, nearest, ranked, "nearest")


def good_ones(frontiers: Sequence[Frontier], config: PlannerConfig) -> list[Frontier]:
    """Those whose value is within 5 % of the highest and clearly above the mean, nearest first."""
    values = np.array([f.value for f in frontiers])
    ratio = values / np.nanmean(values)
    enough = max(config.exploit_min_ratio, _NEAR_THE_BEST * float(np.nanmax(ratio)))
    good = [f for f, r in zip(frontiers, ratio, strict=True) if r >= enough]
    return sorted(good, key=lambda f: f.travel_time_m)[:_MAX_TOUR]


def first_of_tour(frontiers: Sequence[Frontier], way_m: NDArray[np.float64]) -> Frontier:
    """Where the shortest way from the robot over all of them begins; ``way_m`` (n, n) leads from one to another."""

    def length_m(order: tuple[int, ...]) -> float:
        return frontiers[order[0]].travel_time_m + sum(float(way_m[a, b]) for a, b in itertools.pairwise(order))

    return frontiers[min(itertools.permutations(range(len(frontiers))), key=length_m)[0]]


def _ways(context: StepContext, frontiers: Sequence[Frontier]) -> NDArray[np.float64]:
    """Driving distance [m] between frontiers (n, n); straight lines where the map shows no way, or between two only,
    for which it makes no difference."""
    ways = np.array([[math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) for b in frontiers] for a in frontiers])
    for i, a in enumerate(frontiers if len(frontiers) > 2 else ()):
        time_m = coarse_travel_time_m(context.terrain, a.x_m, a.y_m)
        driven = np.array([time_m[context.terrain.cell(b.x_m, b.y_m)] for b in frontiers])
        ways[i] = np.where(np.isfinite(driven), driven, ways[i])
    return ways


APEXNAV = Policy(
    "apexnav",
    "values when they differ enough, else the nearest frontier, ApexNav (https://arxiv.org/abs/2504.14478)",
    lambda task: MissionPolicy(task, CONFIG, rate),
    FusionConfig(),
)
#: Its rule alone, as for VLFM.
APEXNAV_VERIFIED = Policy(
    "apexnav-verified",
    "ApexNav's choice of frontiers (https://arxiv.org/abs/2504.14478) with our verification",
    lambda task: MissionPolicy(task, PlannerConfig(strategy="region"), rate),
    FusionConfig(),
)
