"""The decision: what the robot could do next, and which of it is worth most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from surveilnav.services.planner.core.choice_rules import ChoiceRule, highest_utility, papers_order
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.floors import never_leaves
from surveilnav.services.planner.core.options.candidates import all_candidates, promising_candidates
from surveilnav.services.planner.core.options.closed_passages import closed_passages
from surveilnav.services.planner.core.options.confirmed_objects import confirmed_objects
from surveilnav.services.planner.core.options.doubtful_objects import doubtful_objects
from surveilnav.services.planner.core.options.frontiers import constrained_frontiers, frontiers
from surveilnav.services.planner.core.options.last_resort import accepted_object, last_resort
from surveilnav.services.planner.core.options.option import Option, Proposer
from surveilnav.services.planner.core.options.other_floors import (
    other_floors,
    unless_objects_come_first,
    unsearched_floors,
)
from surveilnav.services.planner.core.options.second_looks import second_looks
from surveilnav.services.planner.core.sequence import least_expected_way

#: Only options of the first group that has any are compared. The first two groups search the floor; the others say what is done
#: once it counts as searched: all is explored that no narrow gap hides, and all looked at that may be the target.
GROUPS: tuple[tuple[Proposer, ...], ...] = (
    (accepted_object, confirmed_objects, promising_candidates, other_floors, frontiers),
    (all_candidates,),
    (unsearched_floors,),
    (doubtful_objects,),
    (second_looks,),
    (constrained_frontiers,),
    (closed_passages,),
    (last_resort,),
)
_N_SEARCHING = 2


@dataclass(frozen=True, slots=True)
class Choice:
    """The option that was chosen, and all that it was compared with, itself included, best first.

    Attributes:
        newly_constrained: (x, y) [m] of frontiers that turned out to be reachable only through narrow gaps.
        searched_chance: set if the floor is searched: the chance of the likeliest object on it that could still be accepted.
    """

    chosen: Option
    compared: tuple[Option, ...]
    newly_constrained: tuple[tuple[float, float], ...] = ()
    searched_chance: float | None = None


CHOICE_RULES: Mapping[str, ChoiceRule] = {
    "utility": highest_utility,
    "sequence": least_expected_way,
    "paper": papers_order,
}


def choose(context: StepContext) -> Choice | None:
    """Chooses what the robot does next; None: nothing is left to do. Nothing is changed."""
    context, is_searched = replace(context), False  # a context of its own, to which what is remembered now applies
    for n, group in enumerate(GROUPS):
        if n == _N_SEARCHING and not never_leaves(context):
            context, is_searched = _with_floor_searched(context), True
        options = _propose(context, group)
        if not options:
            continue
        chosen = CHOICE_RULES[context.config.choice](options, context)
        compared = tuple(sorted(options, key=lambda option: (option is not chosen, -option.utility)))
        constrained = tuple((f.x_m, f.y_m) for f in context.frontiers_by_access[1])
        return Choice(chosen, compared, constrained, context.state.here.best_remaining_chance if is_searched else None)
    return None


def _propose(context: StepContext, group: Sequence[Proposer]) -> list[Option]:
    """The options of a group. If there are none, those that are blacklisted only for a while: the map may have changed."""
    options = unless_objects_come_first([option for proposer in group for option in proposer(context)])
    if options or context.retries_blacklisted or not context.state.here.blacklist.is_waiting(context.state.step):
        return options
    return _propose(replace(context, retries_blacklisted=True), group)


def _with_floor_searched(context: StepContext) -> StepContext:
    """This step once it is recorded that nothing is left to explore or to look at on this floor; and what could still be accepted
    on it as a last resort. The state of ``context`` isn't changed."""
    state = context.state.copy()
    left = objects.last_resorts(context.possible_targets, state, context.config)
    state.here.record_searched(objects.chance(left[0], state.target) if left else 0.0)
    return replace(context, state=state) if context.state.here.is_searched else context.anew(state)
