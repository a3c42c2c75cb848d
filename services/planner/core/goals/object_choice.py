"""Which object to head for: the one of the highest utility, its chance per metre."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from surveilnav.messages import Candidate, ObjectRecord
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.travel import (
    is_behind_passage,
    is_constrained,
    is_reachable,
    travel_time_to,
)


@dataclass(frozen=True, slots=True)
class ObjectGoal:
    """An object to head for.

    Attributes:
        utility: its chance per metre, with travel and looking counted (``object_utility``).
        confirmed: fusion confirmed it as the target.
        has_current: the robot is already heading for one of the compared objects, so frontiers and floors have to be clearly
            better.
        choice: the objects that it was compared with.
    """

    record: ObjectRecord
    utility: float
    confirmed: bool
    has_current: bool
    choice: Choice


def promising_object(context: StepContext) -> ObjectGoal | None:
    """Chooses the object to head for instead of exploring: of the promising ones (``objects.promising``) that of the highest
    utility, where the object that the robot is heading for already is kept unless another is clearly better.

    Blacklisted objects are left out, and so are unconfirmed ones that ``is_deferred`` leaves for the end. Returns None if no
    object is left.
    """
    return _best(context, _available_promising(context))


def any_object(context: StepContext) -> ObjectGoal | None:
    """The same choice from all candidates that aren't blacklisted, however unlikely they are; None if there are none."""
    known = objects.candidates(context.maps.objects, context.state, context.config)
    return _best(context, [o for o in known if not is_left_alone(context, o)])


def current_lost_promise(context: StepContext) -> bool:
    """Whether the robot is heading for an object that isn't promising any more."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.object_id is None or waypoint.is_fallback:
        return False
    return not any(_is_current(context, o) for o in _available_promising(context))


def likeliest_last_resort(context: StepContext) -> ObjectRecord | None:
    """The last resort that was accepted before, while it still is one; else the likeliest that a way leads to."""
    state = context.state
    last_resorts = objects.last_resorts(context.maps.objects, state, context.config)
    accepted = next((o for o in last_resorts if o.id == state.here.accepted_object), None)
    return accepted or next((o for o in last_resorts if is_reachable(context, o)), None)


def current_stairs_utility(context: StepContext) -> float:
    """The utility that the floor goal had when the robot set out for the stairs; 0: it isn't heading for stairs."""
    state = context.state
    heads_for_stairs = state.waypoint is not None and state.waypoint.kind == "stairs"
    return state.floor_goal.utility if heads_for_stairs and state.floor_goal is not None else 0.0


def object_utility(context: StepContext, record: ObjectRecord) -> float:
    """The chance per metre of an object; an accepted last resort comes before everything else."""
    if record.id == context.state.here.accepted_object:
        return 1.0
    chance = objects.chance(record, context.state.target)
    return chance / (travel_time_to(context, record) + context.config.verify_cost_m)


def is_left_alone(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot leaves an object alone for now: it is blacklisted, or behind a closed passage."""
    return is_blacklisted(context, record) or is_behind_passage(context, record)


def is_blacklisted(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot leaves an object alone, for now or permanently, because it failed to reach it."""
    confirmed = objects.is_confirmed(record, context.state.target)
    return context.state.is_blacklisted(*record.center_m[:2], context.config, confirmed=confirmed)


def is_deferred(context: StepContext, record: ObjectRecord) -> bool:
    """Whether an unconfirmed object has to wait until all is explored.

    Either it stopped being promising more than once while the robot was heading for it, and views that disagree must not turn
    the robot to and fro, or only narrow gaps lead there. An accepted last resort is never deferred.
    """
    here = context.state.here
    if record.id == here.accepted_object:
        return False
    if here.oscillations.get(record.id, 0) > 1:
        return True
    return is_constrained(context, *record.center_m[:2], travel_time_to(context, record))


def _best(context: StepContext, known: Sequence[ObjectRecord]) -> ObjectGoal | None:
    """The object of the highest utility; the current one is kept unless another is clearly better."""
    state, config = context.state, context.config
    confirmed = [o for o in known if objects.is_confirmed(o, state.target)]
    if config.confirmed_first and confirmed:
        known = confirmed
    if not known:
        return None
    utility = {o.id: object_utility(context, o) for o in known}
    best = max(known, key=lambda o: utility[o.id])
    current = next((o for o in known if _is_current(context, o)), None)
    keep = current is not None and utility[best.id] <= config.switch_ratio * utility[current.id]
    chosen = current if keep and current is not None else best
    compared = tuple(_candidate(context, o, utility[o.id], chosen=o is chosen) for o in known)
    choice = Choice(next(c for c in compared if c.chosen), compared)
    is_confirmed = objects.is_confirmed(chosen, state.target)
    return ObjectGoal(chosen, utility[chosen.id], is_confirmed, current is not None, choice)


def _candidate(context: StepContext, record: ObjectRecord, utility: float, *, chosen: bool) -> Candidate:
    confirmed = objects.is_confirmed(record, context.state.target)
    kind: Literal["target", "candidate"] = "target" if confirmed else "candidate"
    return Candidate(kind, record.center_m[0], record.center_m[1], utility, chosen, record.reason[:120], record.id)


def _available_promising(context: StepContext) -> list[ObjectRecord]:
    return [
        o
        for o in objects.promising(context.maps.objects, context.state, context.config)
        if not is_left_alone(context, o)
        and (objects.is_confirmed(o, context.state.target) or not is_deferred(context, o))
    ]


def _is_current(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot is heading for an object, also after fusion merged it into another one at the same place."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.object_id is None:
        return False
    x_m, y_m, _ = record.center_m
    is_near = math.hypot(x_m - waypoint.x_m, y_m - waypoint.y_m) < context.config.same_place_m
    return waypoint.object_id == record.id or is_near
