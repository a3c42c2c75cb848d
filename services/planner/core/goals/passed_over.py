"""Objects that may be the target and aren't gone to: why not, for people. Nothing is decided here."""

from __future__ import annotations

from collections.abc import Collection

from surveilnav.messages import Candidate, ObjectRecord
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.object_choice import is_doubtful, is_left_alone, worth_of
from surveilnav.services.planner.core.goals.reach import is_reachable

_SHOWN = 12


def passed_over(context: StepContext, told: Collection[Candidate]) -> tuple[Candidate, ...]:
    """Such objects but for those ``told`` of, the likeliest first, each with its chance per metre and why it waits."""
    state = context.state
    known = {c.object_id for c in told}
    left = [o for o, _ in objects.may_be(context.maps.objects, state.target) if o.id not in known]
    left.sort(key=lambda o: (-objects.chance(o, state.target), o.id))
    return tuple(_candidate(context, o) for o in left[:_SHOWN])


def _candidate(context: StepContext, record: ObjectRecord) -> Candidate:
    confirmed = objects.is_confirmed(record, context.state.target)
    x_m, y_m, _ = record.center_m
    note = _why_not(context, record, confirmed=confirmed)[:120]
    return Candidate(
        "target" if confirmed else "candidate", x_m, y_m, worth_of(context, record), note=note, object_id=record.id
    )


def _why_not(context: StepContext, record: ObjectRecord, *, confirmed: bool) -> str:
    state, config = context.state, context.config
    chance = objects.chance(record, state.target)
    if record.status == "rejected":
        return f"the maps rejected it: {record.reason}"
    if record.id in state.here.dropped:
        return f"the robot looked at it and dropped it: {state.here.dropped[record.id][2]}"
    if objects.near_dropped(record, state, config) and not objects.robot_sees(record, state.target, config):
        return "the robot looked at this place, and the target wasn't there"
    if is_left_alone(context, record):
        return "going there failed"
    if not is_reachable(context, record):
        return "no way leads there yet"
    if not confirmed and is_doubtful(context, record):
        return "views disagree on it, or the way there is tight"
    if config.promising_chance is not None and not confirmed and chance < config.promising_chance:
        return f"its chance of {chance:.2f} is less than {config.promising_chance:.2f}: exploring comes first"
    return f"with a chance of {chance:.2f} something else is worth more per metre"
