"""L3MVN's rule (Yu et al., IROS 2023, https://arxiv.org/abs/2304.05501): what is usually near the target.

Kept: a frontier's score is how likely "a room containing" the objects in the 4 m window around it goes on with the
target, among the categories that can be asked for; without objects 0.1 to 0.2 by cost and utility (its size in cells,
and 8 more within 3 m). Of the four frontiers best by cost and utility, 0.5 to 5 m away if there are such, the likeliest
wins if it scores above 0.3, else the first that scores above 0.1. The goal is chosen anew every 25 steps or when it was
reached. The first detection of the target is believed.
Not kept: GPT-2 and RoBERTa (how often classes share a room in the train homes, ``cooccurrence.json``, stands in), the
random goal where there is no frontier (floors and second looks are everybody's).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from surveilnav.benchmark.policies.cooccurrence import Cooccurrence, of_train
from surveilnav.benchmark.policies.mission import MissionPolicy, first_sight
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.messages import ObjectRecord
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontier_access import current_frontier
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.options.frontiers import only

CONFIG = PlannerConfig(verification="paper", choice="paper")

_WINDOW_M = 2.0
_SURE, _LIKELY = 0.3, 0.1
_EVERY_STEPS = 25
_NEAR_M, _FAR_M, _COSTLY_M, _BONUS_CELLS, _MOST = 0.5, 5.0, 3.0, 8, 4


class L3mvnRule:
    """The likeliest frontier; remembers when it last chose."""

    def __init__(self, known: Cooccurrence) -> None:
        self._known, self._chosen_at = known, -_EVERY_STEPS

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        state = context.state
        if not found:
            return []
        compared = list(found)
        chosen = current_frontier(context, compared, 1.5 * context.config.same_place_m)
        if chosen is None or state.step - self._chosen_at >= _EVERY_STEPS:
            compared = scored(found, context.maps.objects, state.target, self._known)
            chosen, self._chosen_at = likeliest(compared), state.step
        return only(context, chosen, compared, "by what is near")


def scored(
    frontiers: Sequence[Frontier], objects: Iterable[ObjectRecord], target: str, known: Cooccurrence
) -> list[Frontier]:
    """Those that come into question, with scores, in the order of cost and utility."""
    within = [f for f in frontiers if _NEAR_M < f.travel_time_m < _FAR_M] or frontiers
    order = sorted(within, key=lambda f: -_utility(f))[:_MOST]
    things = [o for o in objects if o.status != "rejected" and o.label in known.rooms]
    result = []
    for f in order:
        near = {o.label for o in things if _within(o, f)}
        value = known.likelihood(target, near) if near else 0.1 * _utility(f) / _utility(order[0]) + 0.1
        result.append(replace(f, value=value, score=value))
    return result


def likeliest(frontiers: Sequence[Frontier]) -> Frontier:
    """The goal among scored frontiers in the order of cost and utility."""
    best = max(frontiers, key=lambda f: f.score)
    if best.score > _SURE:
        return best
    return next((f for f in frontiers if f.score > _LIKELY), frontiers[0])


def _utility(frontier: Frontier) -> int:
    return frontier.n_cells + (_BONUS_CELLS if frontier.travel_time_m < _COSTLY_M else 0)


def _within(record: ObjectRecord, frontier: Frontier) -> bool:
    x_m, y_m, _ = record.center_m
    return max(abs(x_m - frontier.x_m), abs(y_m - frontier.y_m)) <= _WINDOW_M


L3MVN = Policy(
    "l3mvn",
    "the frontier whose surroundings suggest the target, L3MVN (https://arxiv.org/abs/2304.05501)",
    lambda task: MissionPolicy(task, CONFIG, L3mvnRule(of_train())),
    first_sight(FusionConfig()),
)
#: Its rule alone, as for VLFM.
L3MVN_VERIFIED = Policy(
    "l3mvn-verified",
    "L3MVN's choice of frontiers (https://arxiv.org/abs/2304.05501) with our verification",
    lambda task: MissionPolicy(task, PlannerConfig(), L3mvnRule(of_train())),
    FusionConfig(),
)
