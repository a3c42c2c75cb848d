"""Looking once more, from another place, at objects that the robot looked at in vain: before it looks around everywhere again."""

from __future__ import annotations

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.options.candidates import is_left_alone, object_option
from surveilnav.services.planner.core.options.option import Option


def doubtful_objects(context: StepContext) -> list[Option]:
    """The dismissed objects that are still promising and that the robot looked at from fewer than ``max_look_places``."""
    return [
        object_option(context, o, is_fallback=True)
        for o in context.possible_targets
        if _is_doubtful(context, o) and not is_left_alone(context, o)
    ]


def _is_doubtful(context: StepContext, record: ObjectRecord) -> bool:
    here, config = context.state.here, context.config
    if record.id not in here.dismissed or record.status == "rejected":
        return False
    if config.verification == "paper" or config.promising_chance is None:
        return False
    if not 0 < len(here.looked_from.get(record.id, ())) < config.max_look_places:
        return False
    return objects.chance(record, context.state.target) >= config.promising_chance
