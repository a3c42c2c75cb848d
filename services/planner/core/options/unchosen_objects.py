"""Objects that may be the target and that the robot isn't heading for, with the reason for people. It decides nothing."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from surveilnav.messages import Candidate, ObjectRecord
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.travel import is_behind_passage, is_reachable
from surveilnav.services.planner.core.options.candidates import is_blacklisted, is_deferred, object_option

_MAX_OBJECTS = 12


def unchosen_objects(context: StepContext, listed: Collection[Candidate]) -> tuple[Candidate, ...]:
    """The likeliest of these objects that aren't ``listed`` already, each with its utility and why it isn't chosen."""
    state = context.state
    known = {c.object_id for c in listed}
    others = [o for o in context.possible_targets if o.id not in known]
    others.sort(key=lambda o: (-objects.chance(o, state.target), o.id))
    return tuple(_candidate(context, o) for o in others[:_MAX_OBJECTS])


def _candidate(context: StepContext, record: ObjectRecord) -> Candidate:
    option = object_option(context, record)
    return replace(option, why=_why_not(context, record, confirmed=option.kind == "target")).to_candidate(chosen=False)


def _why_not(context: StepContext, record: ObjectRecord, *, confirmed: bool) -> str:
    state, config = context.state, context.config
    chance = objects.chance(record, state.target)
    if record.status == "rejected":
        return f"the maps rejected it: {record.reason}"
    if record.id in state.here.dismissed:
        return f"the robot looked at it and dismissed it: {state.here.dismissed[record.id].why}"
    if objects.is_near_dismissed(record, state, config) and not objects.robot_sees(record, state.target, config):
        return "the robot looked at this place, and the target wasn't there"
    if is_blacklisted(context, record):
        return "going there failed"
    if is_behind_passage(context, record):
        names = " or ".join(area.name for area in context.reach.closed_passages)
        return f"it is behind {names}, which is closed"
    if not is_reachable(context, record):
        return "no way leads there yet"
    if not confirmed and is_deferred(context, record):
        return "views disagree on it, or only narrow gaps lead there"
    if config.promising_chance is not None and not confirmed and chance < config.promising_chance:
        return f"its chance of {chance:.2f} is less than {config.promising_chance:.2f}: exploring comes first"
    return f"with a chance of {chance:.2f} something else is worth more per metre"
