"""The initial scan: a full look around when the robot comes to a floor (the paper's "initialization", section IV-E)."""

from __future__ import annotations

from surveilnav.services.planner.core.choice import Choice
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.travel import travel_time_to

_LIKELY = 0.5


def initial_scan(context: StepContext, choice: Choice | None) -> Decision | None:
    """A turn of the scan. None: the scan is over, or there is none on this floor.

    There is no scan where an object near by is most likely the target, nor where no object of this floor may be the target
    and it was seen on another floor. In all other cases a scan costs less than missing what is behind the robot, or heading
    into a wall that no camera sees.
    """
    state, robot, turns = context.state, context.robot, context.config.scan_turns
    if state.here.scan_turns_left == 0:
        return None
    known = objects.promising(context.possible_targets, state, context.config)
    likely = [o for o in known if objects.chance(o, state.target) >= _LIKELY]
    if any(travel_time_to(context, o) <= context.config.skip_scan_within_m for o in likely):
        state.here.skip_scan()
        return None
    if state.here.scan_turns_left is None:
        if known and state.floor_goal is not None:
            return None  # on the way to another floor: the choice compares that with what is here
        by_evidence = choice is not None and choice.chosen.kind == "stairs" and choice.searched_chance is None
        if not known and not context.maps.pending_views and by_evidence:
            return None
        state.here.begin_scan(robot.x_m, robot.y_m, turns)
    state.record_scan_turn()
    turns_taken = turns - (state.here.scan_turns_left or 0)
    return context.decide("turn_left", "scanning", f"looking around, {turns_taken} of {turns}")
