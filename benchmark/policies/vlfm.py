"""VLFM's rule (Yokoyama et al., ICRA 2024, https://arxiv.org/abs/2312.03275): the frontier of the highest value.

Kept: the value map with confidence-weighted averages, a frontier's value the median of what is known within 0.5 m, no
price for the way, the frontier last chosen kept (also where it moved up to 0.5 m) as long as its value doesn't fall by
0.01, the scan at the start, frontiers only at unexplored areas of at least 1.5 m2, the first detection of the target
believed, and the stop at 0.9 m of it.
Not kept: BLIP-2 (values come from the backend's own embeddings), the learnt PointNav policy (the driver is everybody's),
giving up when there is no frontier left (floors and second looks are everybody's), and its program's list of states that
mustn't come again (a place without progress is given up).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from surveilnav.benchmark.policies.mission import MissionPolicy, first_sight
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.services.fusion.core import FusionConfig, MapConfig, ValueConfig
from surveilnav.services.planner.core import FloorMaps, PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontier_access import current_frontier
from surveilnav.services.planner.core.goals.frontiers import Frontier, values_near
from surveilnav.services.planner.core.options.frontiers import only

CONFIG = PlannerConfig(verification="paper", choice="paper", value_radius_m=0.5, standoff_m=0.85, stop_m=0.9)
FUSION = first_sight(FusionConfig(map=MapConfig(frontier_hole_m2=1.5), value=ValueConfig(fusion="confidence")))

_SAME_M = 0.5
_WORSE = 0.01


class VlfmRule:
    """Chooses the frontier of the highest value.

    It remembers the value of the frontier that it chose last, because that frontier is kept until its value falls.
    """

    def __init__(self) -> None:
        self._last_value = 0.0

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        compared = [valued(frontier, context.maps, context.config) for frontier in found]
        if not compared:
            return []
        chosen = best(compared, current_frontier(context, compared, _SAME_M), self._last_value)
        self._last_value = chosen.value
        return only(context, chosen, compared, "by value")


def valued(frontier: Frontier, maps: FloorMaps, config: PlannerConfig) -> Frontier:
    """The frontier with its value and score set: the median of the values known near it; 0 if the map knows none."""
    known = values_near(maps, frontier, config.value_radius_m)
    value = float(np.median(known)) if known.size else 0.0
    return replace(frontier, value=value, score=value)


def best(frontiers: Sequence[Frontier], current: Frontier | None, last_value: float) -> Frontier:
    """The highest value, of equals the nearest; the current one as long as it keeps its value."""
    if current is not None and current.value + _WORSE > last_value:
        return current
    return min(frontiers, key=lambda f: (-f.value, f.travel_time_m))


VLFM = Policy(
    "vlfm",
    "the frontier of the highest value, VLFM (https://arxiv.org/abs/2312.03275)",
    lambda task: MissionPolicy(task, CONFIG, VlfmRule()),
    FUSION,
)
#: Its rule alone, so that a weak belief in detectors isn't mistaken for a weak rule.
VLFM_VERIFIED = Policy(
    "vlfm-verified",
    "VLFM's choice of frontiers (https://arxiv.org/abs/2312.03275) with our verification",
    lambda task: MissionPolicy(task, PlannerConfig(value_radius_m=CONFIG.value_radius_m), VlfmRule()),
    FusionConfig(map=FUSION.map, value=FUSION.value),
)
