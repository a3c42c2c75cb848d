"""Going to an object that may be the target."""

from __future__ import annotations

import math

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.travel import is_behind_passage, is_constrained, travel_time_to
from surveilnav.services.planner.core.options.option import Option


def promising_candidates(context: StepContext) -> list[Option]:
    """Unconfirmed objects that are likely enough to interrupt exploring (``objects.promising``), and not ``is_deferred``."""
    state = context.state
    return [
        object_option(context, o)
        for o in objects.promising(context.possible_targets, state, context.config)
        if not objects.is_confirmed(o, state.target)
        and o.id != state.here.accepted_object
        and not is_left_alone(context, o)
        and not is_deferred(context, o)
    ]


def all_candidates(context: StepContext) -> list[Option]:
    """All objects that may be the target, however unlikely: for when nothing is left to explore."""
    known = objects.candidates(context.possible_targets, context.state, context.config)
    return [object_option(context, o, is_fallback=True) for o in known if not is_left_alone(context, o)]


def object_option(
    context: StepContext, record: ObjectRecord, *, is_fallback: bool = False, is_accepted: bool = False
) -> Option:
    """Going to an object and looking at it. One that is accepted comes before everything else."""
    is_confirmed = objects.is_confirmed(record, context.state.target)
    chance = objects.chance(record, context.state.target)
    cost_m = travel_time_to(context, record) + context.config.verify_cost_m
    return Option(
        "target" if is_confirmed else "candidate",
        *record.center_m[:2],
        chance,
        cost_m,
        utility=1.0 if is_accepted else chance / cost_m,
        why=record.reason,
        record=record,
        is_current=is_current(context, record),
        is_fallback=is_fallback,
        is_accepted=is_accepted,
        spend_m=context.config.verify_cost_m,
    )


def is_left_alone(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot leaves an object alone for now: it is blacklisted, or behind a closed passage."""
    return is_blacklisted(context, record) or is_behind_passage(context, record)


def is_blacklisted(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot leaves an object alone, for now or permanently, because it failed to reach it."""
    confirmed = objects.is_confirmed(record, context.state.target)
    return context.is_blacklisted(*record.center_m[:2], confirmed=confirmed)


def is_deferred(context: StepContext, record: ObjectRecord) -> bool:
    """Whether an unconfirmed object has to wait until all is explored.

    Either it stopped being promising more than once while the robot was heading for it, and views that disagree must not turn
    the robot to and fro, or only narrow gaps lead there.
    """
    if context.state.here.oscillations.get(record.id, 0) > 1:
        return True
    return is_constrained(context, *record.center_m[:2], travel_time_to(context, record))


def is_current(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot is heading for an object, also after fusion merged it into another one at the same place."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.object_id is None:
        return False
    x_m, y_m, _ = record.center_m
    is_near = math.hypot(x_m - waypoint.x_m, y_m - waypoint.y_m) < context.config.same_place_m
    return waypoint.object_id == record.id or is_near
