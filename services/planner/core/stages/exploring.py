"""What stages share about exploring: which frontiers are worth a way, and what they are weighed against."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from surveilnav.messages import Candidate
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import Choice, FrontierChoice, StepContext
from surveilnav.services.planner.core.goals.frontier_choice import all_frontiers
from surveilnav.services.planner.core.goals.frontiers import Frontier, rank
from surveilnav.services.planner.core.goals.reach import is_hard
from surveilnav.services.planner.core.pursuit.explore import explore
from surveilnav.services.planner.core.stages.stage import RETRY, Retry
from surveilnav.services.planner.core.state import Decision


@dataclass(frozen=True, slots=True)
class Exploring:
    """What exploring has against another waypoint.

    ``outdoes``: some frontier promises more per metre. ``hard``: frontiers found hard to get to on the way; to be put off.
    """

    outdoes: bool
    hard: Sequence[Frontier] = ()


def weigh_exploring(context: StepContext, worth: float) -> Exploring:
    """Exploring against a waypoint of this chance per metre. Changes nothing."""
    config = context.config
    chance = config.explore_chance
    if config.objects_first or chance * (1.0 + config.value_gain) <= worth * config.explore_m:
        return Exploring(False)  # no frontier could, so none is looked at
    easy, hard = _easy_and_hard(context)
    if not easy:
        return Exploring(False, hard)
    ranked, _ = rank(easy, context.maps, context.state.target, config)
    return Exploring(chance * ranked[0].score > worth, hard)


def put_off(context: StepContext, hard: Sequence[Frontier]) -> None:
    """Notes, for good, that frontiers are hard to get to."""
    for f in hard:
        memory.put_off(context.state, f.x_m, f.y_m)


def put_off_hard_frontiers(context: StepContext) -> list[Frontier]:
    """Puts off the frontiers that are hard to get to, and returns the others that aren't blacklisted."""
    easy, hard = _easy_and_hard(context)
    put_off(context, hard)
    return easy


def _easy_and_hard(context: StepContext) -> tuple[list[Frontier], list[Frontier]]:
    """The frontiers that aren't blacklisted or put off. What is beside a hard one before it in the list is neither."""
    near_m = context.config.same_place_m
    places = list(context.state.here.put_off)
    easy: list[Frontier] = []
    hard: list[Frontier] = []
    for f in all_frontiers(context):
        if any(math.dist(place, (f.x_m, f.y_m)) < near_m for place in places):
            continue
        if is_hard(context, f.x_m, f.y_m, f.way_m):
            places.append((f.x_m, f.y_m))
            hard.append(f)
        else:
            easy.append(f)
    return easy, hard


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
