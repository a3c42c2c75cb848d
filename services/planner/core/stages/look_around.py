"""The first look around on a floor (the paper's "initialization", section IV-E)."""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.reach import way_to
from surveilnav.services.planner.core.stages.other_floor import other_floor
from surveilnav.services.planner.core.state import Decision

_LIKELY = 0.5


def look_around(context: StepContext) -> Decision | None:
    """A turn of it; None: it is over, or there is none.

    There is none where something near by is most likely the target, nor where nothing here may be it and it was seen on
    another floor: a look around costs less than going by what stands behind the robot, or into a wall that no camera sees.
    While views of this floor's cameras are still to come, another floor has to wait: they may show the target here.
    """
    state, robot, turns = context.state, context.robot, context.config.scan_turns
    if state.here.scan_left == 0:
        return None
    known = objects.promising(context.maps.objects, state, context.config)
    likely = [o for o in known if objects.chance(o, state.target) >= _LIKELY]
    if any(way_to(context, o) <= context.config.scan_unless_m for o in likely):
        memory.skip_scan(state)
        return None
    if state.here.scan_left is None:
        if known and state.floor_goal is not None:
            return None  # on the way elsewhere: what is worth more is weighed
        if not known and not context.maps.pending_views and (decision := other_floor(context)):
            return decision
        memory.begin_scan(state, robot, turns)
    memory.continue_scan(state)
    return context.decide("turn_left", "scanning", f"looking around, {turns - (state.here.scan_left or 0)} of {turns}")
