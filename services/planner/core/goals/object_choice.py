"""Which object to go to: the one most worth its way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from surveilnav.messages import Candidate, ObjectRecord
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.reach import is_hard, is_reachable, way_to


@dataclass(frozen=True, slots=True)
class ObjectGoal:
    """An object to go to.

    ``worth``: its chance per metre (``objects.chance``, way and looking counted). ``held``: the robot is on its way to one
    of those compared, so whatever is no object has to be clearly better. ``choice``: what it was compared with.
    """

    record: ObjectRecord
    worth: float
    confirmed: bool
    held: bool
    choice: Choice


def promising_object(context: StepContext) -> ObjectGoal | None:
    """The best of the promising candidates that aren't blacklisted, hard to get to or wavering; confirmed ones may be."""
    return _best(context, _awake_promising(context))


def any_object(context: StepContext) -> ObjectGoal | None:
    """The best of all candidates that aren't blacklisted: also those that hardly anything speaks for."""
    known = objects.candidates(context.maps.objects, context.state, context.config)
    return _best(context, [o for o in known if not is_left_alone(context, o)])


def lost_promise(context: StepContext) -> bool:
    """Whether the robot is on its way to an object that isn't promising any more."""
    held = context.state.waypoint
    on_the_way = held is not None and held.object_id is not None and not held.unpromising
    return on_the_way and not any(_is_held(context, o) for o in _awake_promising(context))


def likeliest_last_resort(context: StepContext) -> ObjectRecord | None:
    """The last resort that was accepted before, while it is one, else the likeliest that a way leads to."""
    state = context.state
    may_be = objects.last_resorts(context.maps.objects, state, context.config)
    accepted = next((o for o in may_be if o.id == state.here.accepted_object), None)
    return accepted or next((o for o in may_be if is_reachable(context, o)), None)


def floor_goal_worth(context: StepContext) -> float:
    """What the way to the stairs that the robot is on was worth when it set out: to be beaten clearly, as the waypoint
    held always is."""
    state = context.state
    on_the_way = state.waypoint is not None and state.waypoint.kind == "stairs"
    return state.floor_goal.worth if on_the_way and state.floor_goal is not None else 0.0


def _best(context: StepContext, known: Sequence[ObjectRecord]) -> ObjectGoal | None:
    """The one most worth its way; the one that the robot is on its way to unless another is clearly better."""
    state, config = context.state, context.config
    confirmed = [o for o in known if objects.is_confirmed(o, state.target)]
    if config.confirmed_first and confirmed:
        known = confirmed
    if not known:
        return None
    worth = {o.id: worth_of(context, o) for o in known}
    best = max(known, key=lambda o: worth[o.id])
    held = next((o for o in known if _is_held(context, o)), None)
    chosen = held if held is not None and worth[best.id] <= config.switch_ratio * worth[held.id] else best
    compared = tuple(_candidate(context, o, worth[o.id], chosen=o is chosen) for o in known)
    choice = Choice(next(c for c in compared if c.chosen), compared)
    sure = objects.is_confirmed(chosen, state.target)
    return ObjectGoal(chosen, worth[chosen.id], sure, held is not None, choice)


def _candidate(context: StepContext, record: ObjectRecord, worth: float, *, chosen: bool) -> Candidate:
    confirmed = objects.is_confirmed(record, context.state.target)
    kind: Literal["target", "candidate"] = "target" if confirmed else "candidate"
    return Candidate(kind, record.center_m[0], record.center_m[1], worth, chosen, record.reason[:120], record.id)


def worth_of(context: StepContext, record: ObjectRecord) -> float:
    """The chance per metre of an object; an accepted last resort comes before all else."""
    if record.id == context.state.here.accepted_object:
        return 1.0
    chance = objects.chance(record, context.state.target)
    return chance / (way_to(context, record) + context.config.verify_m)


def _awake_promising(context: StepContext) -> list[ObjectRecord]:
    return [
        o
        for o in objects.promising(context.maps.objects, context.state, context.config)
        if not is_left_alone(context, o)
        and (objects.is_confirmed(o, context.state.target) or not is_doubtful(context, o))
    ]


def _is_held(context: StepContext, record: ObjectRecord) -> bool:
    """The object that the robot is on its way to, also after fusion merged it into another at the same place."""
    held = context.state.waypoint
    if held is None or held.object_id is None:
        return False
    near = math.hypot(record.center_m[0] - held.x_m, record.center_m[1] - held.y_m) < context.config.same_place_m
    return held.object_id == record.id or near


def is_left_alone(context: StepContext, record: ObjectRecord) -> bool:
    """Whether the robot leaves it alone, for now or for good, since going there failed."""
    confirmed = objects.is_confirmed(record, context.state.target)
    return memory.is_blacklisted(context.state, *record.center_m[:2], context.config, confirmed=confirmed)


def is_doubtful(context: StepContext, record: ObjectRecord) -> bool:
    """Whether an unconfirmed object had better wait: it stopped being promising more than once with the robot on its way
    there (views that disagree must not turn it to and fro), or is hard to get to. An accepted last resort isn't."""
    here = context.state.here
    if record.id == here.accepted_object:
        return False
    if here.wavered.get(record.id, 0) > 1:
        return True
    return is_hard(context, *record.center_m[:2], way_to(context, record))
