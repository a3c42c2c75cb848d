"""What stages share about exploring: which frontiers are worth a way, and what they are weighed against."""

from __future__ import annotations

import math

from services.planner.core import memory
from services.planner.core.context import Choice, FrontierChoice, StepContext
from services.planner.core.goals.frontier_choice import all_frontiers
from services.planner.core.goals.frontiers import Frontier, rank
from services.planner.core.goals.reach import is_hard
from services.planner.core.pursuit.explore import explore
from services.planner.core.stages.stage import RETRY, Retry
from services.planner.core.state import Decision
from surveilnav.messages import Candidate


def put_off_hard_frontiers(context: StepContext) -> list[Frontier]:
    """Notes which frontiers are hard to get to, for good, and returns the others that aren't blacklisted."""
    put_off, near_m = context.state.here.put_off, context.config.same_place_m
    easy = []
    for f in all_frontiers(context):
        if any(math.dist(place, (f.x_m, f.y_m)) < near_m for place in put_off):
            continue
        if is_hard(context, f.x_m, f.y_m, f.way_m):
            memory.put_off(context.state, f.x_m, f.y_m)
        else:
            easy.append(f)
    return easy


def put_off_and_weigh_exploring(context: StepContext, worth: float) -> bool:
    """Whether some frontier promises more per metre than this; notes those that are hard to get to."""
    config = context.config
    chance = config.explore_chances.get(context.state.target, config.explore_chance)
    if config.objects_first or chance * (1.0 + config.value_gain) <= worth * config.explore_m:
        return False
    if not (frontiers := put_off_hard_frontiers(context)):
        return False
    ranked, _ = rank(frontiers, context.maps, context.state.target, config)
    return chance * ranked[0].score > worth


def explore_chosen(context: StepContext, found: FrontierChoice | None) -> Decision | Retry | None:
    """Commits to the frontier that a rule chose and drives there."""
    if found is None:
        return None
    compared = tuple(
        Candidate("frontier", f.x_m, f.y_m, f.score, f is found.chosen, f"{found.why}, {f.way_m:.1f} m")
        for f in found.compared
    )
    choice = Choice(next(c for c in compared if c.chosen), compared)
    memory.commit(context.state, choice.chosen, context.config)
    return explore(context, found.chosen, choice) or RETRY
