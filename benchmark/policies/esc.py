"""ESC's rule (Zhou et al., ICML 2023, https://arxiv.org/abs/2301.13166): soft constraints and the way.

Kept (as in SG-Nav's program, which builds on ESC's, https://github.com/bagh2178/SG-Nav): a class of objects within 1.6 m of a
frontier speaks for it by how likely the target is beside that class, and against it by how unlikely; so does the room that it
lies in; twice the shortness of the way is added, 1 at 1.6 m and 0 from 11.6 m on. Frontiers nearer than 1.6 m are left out as
long as there are others. The highest sum wins and is kept until it is explored. The first detection of the target is believed.
Not kept: DeBERTa (how often classes share a room in the train homes, ``cooccurrence.json``, stands in), GLIP's words for rooms (a
room is what is known within 3 m of the frontier), the solver for probabilistic soft logic (that program adds up, too), and the
random goal where there is no frontier (floors and second looks are everybody's).
"""

from __future__ import annotations

import math
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

_OBJECT_WITHIN_M, _ROOM_WITHIN_M = 1.6, 3.0
_NEAREST_M, _FAR_M, _WAY_WEIGHT = 1.6, 11.6, 2.0


def rate(context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
    """See ``FrontierRule``."""
    if not found:
        return []
    scored = scored_frontiers(found, context.maps.objects, context.state.target, of_train())
    current = current_frontier(context, scored, 1.5 * context.config.same_place_m)
    chosen = current or max(scored, key=lambda f: f.score)
    return only(context, chosen, scored, "by soft constraints")


def scored_frontiers(
    frontiers: Sequence[Frontier], objects: Iterable[ObjectRecord], target: str, known: Cooccurrence
) -> list[Frontier]:
    """The frontiers that come into question, with scores. For a target that nothing is known of, the way alone counts."""
    within = [f for f in frontiers if f.travel_time_m >= _NEAREST_M] or frontiers
    things = [o for o in objects if target in known.rooms and o.status != "rejected" and o.label in known.rooms]
    return [
        replace(f, score=_constraints(f, things, target, known) + _WAY_WEIGHT * shortness(f.travel_time_m))
        for f in within
    ]


def shortness(way_m: float) -> float:
    """1 for a way of 1.6 m or less, 0 for one of 11.6 m or more."""
    return 1.0 - (min(max(way_m, _NEAREST_M), _FAR_M) - _NEAREST_M) / (_FAR_M - _NEAREST_M)


def constraint(likely: float, near: float) -> float:
    """What something near a frontier adds to its score, -1 to 1.

    It is how far "``near`` and ``likely``" is true, less how far "``near`` and not ``likely``" is, both by Lukasiewicz's logic.
    """
    return max(0.0, likely + near - 1.0) - max(0.0, near - likely)


def _constraints(frontier: Frontier, things: Sequence[ObjectRecord], target: str, known: Cooccurrence) -> float:
    near: dict[str, float] = {}
    room: set[str] = set()
    for o in things:
        away_m = math.hypot(o.center_m[0] - frontier.x_m, o.center_m[1] - frontier.y_m)
        if away_m < _OBJECT_WITHIN_M:
            near[o.label] = max(near.get(o.label, 0.0), o.confidence)
        if away_m < _ROOM_WITHIN_M:
            room.add(o.label)
    by_objects = sum(constraint(known.chance(target, [label]), confidence) for label, confidence in near.items())
    return by_objects + (constraint(known.chance(target, room), 1.0) if room else 0.0)


ESC = Policy(
    "esc",
    "what is near a frontier as soft constraints, and the way, ESC (https://arxiv.org/abs/2301.13166)",
    lambda task: MissionPolicy(task, CONFIG, rate),
    first_sight(FusionConfig()),
)
#: Its rule alone, as for VLFM.
ESC_VERIFIED = Policy(
    "esc-verified",
    "ESC's choice of frontiers (https://arxiv.org/abs/2301.13166) with our verification",
    lambda task: MissionPolicy(task, PlannerConfig(), rate),
    FusionConfig(),
)
