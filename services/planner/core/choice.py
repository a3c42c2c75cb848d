"""The decision: what the robot could do next, and which of it is worth most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.floors import never_leaves
from surveilnav.services.planner.core.goals.frontier_access import split_by_access
from surveilnav.services.planner.core.motion.terrain import coarse_travel_time_m
from surveilnav.services.planner.core.options.candidates import all_candidates, promising_candidates
from surveilnav.services.planner.core.options.closed_passages import closed_passages
from surveilnav.services.planner.core.options.confirmed_objects import confirmed_objects
from surveilnav.services.planner.core.options.frontiers import constrained_frontiers, frontiers
from surveilnav.services.planner.core.options.last_resort import accepted_object, last_resort
from surveilnav.services.planner.core.options.option import Option, OptionKind, Proposer
from surveilnav.services.planner.core.options.other_floors import other_floors, unsearched_floors
from surveilnav.services.planner.core.options.second_looks import second_looks
from surveilnav.services.planner.core.sequence import expected_way_m

#: Only options of the first group that has any are compared. The first two groups search the floor; the others say what is done
#: once nothing on it is left to explore or to look at.
GROUPS: tuple[tuple[Proposer, ...], ...] = (
    (accepted_object, confirmed_objects, promising_candidates, other_floors, frontiers),
    (all_candidates,),
    (unsearched_floors,),
    (second_looks,),
    (constrained_frontiers,),
    (closed_passages,),
    (last_resort,),
)
_N_SEARCHING = 2
_IN_SEQUENCE = ("target", "candidate", "frontier")
#: Objects stand in inflated obstacles: the way ends so near to them.
_NEAR_M = 1.0


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


ChoiceRule = Callable[[Sequence[Option], StepContext], Option]


def highest_utility(options: Sequence[Option], context: StepContext) -> Option:
    """Ours: the highest chance per expected metre. The current option is kept unless another is clearly better (hysteresis).

    For options that lie apart like spokes, taking them by chance per cost finds the target on the shortest expected way
    (Smith's rule, https://doi.org/10.1002/nav.3800030106).
    """
    best = max(options, key=lambda option: option.utility)
    current = max((o for o in options if o.is_current), key=lambda option: option.utility, default=None)
    return current if current and best.utility <= context.config.switch_ratio * current.utility else best


_PAPERS_ORDER: tuple[OptionKind, ...] = ("target", "candidate", "stairs", "frontier", "second_look", "passage")


def papers_order(options: Sequence[Option], context: StepContext) -> Option:
    """The paper's (section IV-E): a confirmed target, else a promising candidate, else the best frontier; other floors, of which
    it doesn't speak, before frontiers."""
    first = min((o.kind for o in options if not o.is_accepted), key=_PAPERS_ORDER.index, default=None)
    return highest_utility([o for o in options if o.is_accepted or o.kind == first], context)


def least_expected_way(options: Sequence[Option], context: StepContext) -> Option:
    """The first of the order in which the way until the target is found is expected to be the shortest (``sequence``).

    Only objects and frontiers are put in an order, at most ``sequence_options`` of the highest utility. If something else has the
    highest utility of all, that is chosen. The current option is kept unless another order saves ``sequence_margin_m``.
    """
    config, best = context.config, highest_utility(options, context)
    if best.is_accepted or best.kind not in _IN_SEQUENCE:
        return best
    ranked = sorted(options, key=lambda o: (not o.is_current, -o.utility))
    among = [o for o in ranked if o.kind in _IN_SEQUENCE and o.utility > 0.0][: config.sequence_options]
    if len(among) < 2:
        return best
    spend_m = np.array([o.spend_m for o in among])
    first_m = np.array([o.cost_m for o in among]) - spend_m
    way_m = expected_way_m(np.array([o.chance for o in among]), spend_m, first_m, _ways_between(context, among))
    shortest = int(np.argmin(way_m))
    is_kept = among[0].is_current and way_m[0] <= way_m[shortest] + config.sequence_margin_m
    return among[0] if is_kept else among[shortest]


def _ways_between(context: StepContext, options: Sequence[Option]) -> NDArray[np.float64]:
    """(n, n) travel time [m] between options; twice the distance where the map shows no way."""
    places = np.array([(o.x_m, o.y_m) for o in options])
    ways_m = 2.0 * np.linalg.norm(places[:, None] - places, axis=2)
    for i, a in enumerate(options):
        time_m = coarse_travel_time_m(context.terrain, a.x_m, a.y_m)
        for j, b in enumerate(options):
            known_m = context.terrain.min_near(time_m, b.x_m, b.y_m, _NEAR_M)
            ways_m[i, j] = known_m if np.isfinite(known_m) else ways_m[i, j]
    return np.asarray(ways_m, np.float64)


CHOICE_RULES: Mapping[str, ChoiceRule] = {
    "utility": highest_utility,
    "sequence": least_expected_way,
    "paper": papers_order,
}


def choose(context: StepContext) -> Choice | None:
    """Chooses what the robot does next; None: nothing is left to do. Nothing is changed."""
    for n, group in enumerate(GROUPS):
        options = _propose(context, group)
        if not options:
            continue
        chosen = CHOICE_RULES[context.config.choice](options, context)
        compared = tuple(sorted(options, key=lambda option: (option is not chosen, -option.utility)))
        is_searched = n >= _N_SEARCHING and not never_leaves(context)
        constrained = tuple((f.x_m, f.y_m) for f in split_by_access(context)[1])
        return Choice(chosen, compared, constrained, _likeliest_left(context) if is_searched else None)
    return None


def _propose(context: StepContext, group: Sequence[Proposer]) -> list[Option]:
    """The options of a group. If there are none, those that are blacklisted only for a while: the map may have changed."""
    options = [option for proposer in group for option in proposer(context)]
    if options or context.retries_blacklisted or not context.state.here.blacklist.is_waiting(context.state.step):
        return options
    return _propose(replace(context, retries_blacklisted=True), group)


def _likeliest_left(context: StepContext) -> float:
    """The chance of the likeliest object of this floor that could still be accepted as a last resort; 0: there is none."""
    left = objects.last_resorts(context.maps.objects, context.state, context.config)
    return objects.chance(left[0], context.state.target) if left else 0.0
