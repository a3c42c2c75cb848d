"""Approaching an object: going near, looking, verifying it (on two levels), and stopping."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.behaviours.follow_route import follow_route, level_camera
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.goal_region import GoalRegion
from surveilnav.services.planner.core.goals.verification import Verification, is_likely_enough, verify
from surveilnav.services.planner.core.motion.drive import bearing_error_rad, turn_towards
from surveilnav.services.planner.core.options.option import Option

#: The longest way [m] to another place to look at the same object from.
_ELSEWHERE_WITHIN_M = 5.0


@dataclass(frozen=True, slots=True)
class _Approach:
    """An approach to an object at this step: the option that it serves, and what the joint map says of it now."""

    context: StepContext
    record: ObjectRecord
    option: Option
    verification: Verification


def approach_object(context: StepContext, option: Option) -> Decision | None:
    """Goes near an object, looks at it on the way, and stops if it is the target. None: it was dismissed or blacklisted."""
    record = option.record
    assert record is not None
    verification = _verification_of(context, record)
    if verification == "contradicted":
        _dismiss(context, record, f"the robot sees {record.label_robot or 'something else'}")
        return None
    region = _region_elsewhere(context, record) or context.reach.goal_region(record)
    if region is None:
        if objects.is_confirmed(record, context.state.target):
            context.state.record_unreachable(record, context.area_at(*record.center_m[:2]))
        context.state.blacklist_place(*record.center_m[:2], context.config)
        return None
    approach = _Approach(context, record, option, verification)
    if _has_arrived(context, region):
        return _look_and_decide(approach)
    return level_camera(context, option) or _turn_to_unverified(approach, region) or _drive_nearer(approach, region)


def _verification_of(context: StepContext, record: ObjectRecord) -> Verification:
    """What the joint map says now. What contradicted an object before doesn't do so again once it is accepted as a last resort,
    or on the way to where it is looked at once more."""
    verification, here = verify(record, context.state.target, context.config), context.state.here
    accepted = record.id == here.accepted_object
    if verification == "contradicted" and accepted and objects.is_ruled_out(record, context.state, context.config):
        return "open"
    return "open" if verification == "contradicted" and record.id in here.dismissed else verification


def _region_elsewhere(context: StepContext, record: ObjectRecord) -> GoalRegion | None:
    """The goal region elsewhere than where the robot looked at an object in vain.

    None: it didn't, it did so from enough places, no other is there, or the object is accepted as a last resort: steps for the
    shortest way are all that is left then.
    """
    looked_from = tuple(context.state.here.looked_from.get(record.id, ()))
    is_accepted = record.id == context.state.here.accepted_object
    if (
        is_accepted
        or context.config.verification == "paper"
        or not 0 < len(looked_from) < context.config.max_look_places
    ):
        return None
    return context.reach.goal_region(record, looked_from)


def _dismiss(context: StepContext, record: ObjectRecord, why: str) -> None:
    """Records that an object isn't the target as seen from here."""
    context.state.here.record_looked_from(record.id, context.robot.x_m, context.robot.y_m)
    context.state.dismiss(record, why)


def _has_arrived(context: StepContext, region: GoalRegion) -> bool:
    here = context.terrain.cell(context.robot.x_m, context.robot.y_m)
    is_near = float(region.distance_m[here]) <= max(context.config.stop_m, region.nearest_m)
    return bool(region.goals[here]) or (is_near and bool(region.sight[here]))


def _turn_to_unverified(approach: _Approach, region: GoalRegion) -> Decision | None:
    """On the way, turns to an unverified object once it is near by and in sight, until it was seen from near by."""
    context, record = approach.context, approach.record
    memory, config, max_turns = context.state.here, context.config, context.config.scan_turns // 2
    if approach.verification == "verified" or not _sees_from_within(context, region, config.inspect_m):
        return None
    error_rad = bearing_error_rad(context.robot, *record.center_m[:2])
    if abs(error_rad) <= config.half_fov_rad:  # it is in view now, so there is no need to turn back to it later
        memory.record_inspection(record.id, max_turns)
        return None
    turns = memory.inspection_turns.get(record.id, 0)
    if turns >= max_turns:
        return None
    memory.record_inspection(record.id, turns + 1)
    turn = "turn_left" if error_rad > 0 else "turn_right"
    return context.decide(turn, "confirming", f"turning to {_describe(context, record)}", approach.option)


def _drive_nearer(approach: _Approach, region: GoalRegion) -> Decision | None:
    """Takes a step nearer. Where no way leads nearer, stops if the object is verified or accepted and in sight."""
    context, record = approach.context, approach.record
    route = follow_route(context, region.goals)
    if route is not None:
        message = f"to {_describe(context, record)}, {route.remaining_m:.1f} m"
        return context.decide(route.action, "approaching", message, approach.option, route)
    if not _sees_from_within(context, region, context.config.farthest_stop_m):
        return None
    if approach.verification == "verified":
        return _found(approach, "seen by the robot itself, and no way leads nearer")
    return _accepted(approach) if record.id == context.state.here.accepted_object else None


def _look_and_decide(approach: _Approach) -> Decision | None:
    """At the object: faces it and stops if it is verified; else looks in a few more directions and then decides."""
    context, record = approach.context, approach.record
    state, config = context.state, context.config
    state.reset_stuck_timer()
    verified = approach.verification == "verified"
    looks_taken = state.here.extra_looks.get(record.id, 0)
    turn = turn_towards(context.robot, *record.center_m[:2], config)
    waited = state.step - state.waypoint.progress_step if state.waypoint is not None else 0
    if turn and waited < config.patience_steps and (verified or looks_taken == 0):
        return context.decide(turn, "confirming", f"turning to {_describe(context, record)}", approach.option)
    if verified:
        return _found(approach, "seen by the robot itself")
    looks = _extra_looks(context, record)
    if looks_taken < len(looks) and config.verification != "paper":
        state.here.record_extra_look(record.id)
        message = f"looking at {_describe(context, record)} again, {looks_taken + 1} of {len(looks)}"
        return context.decide(looks[looks_taken], "confirming", message, approach.option)
    if decision := _look_from_elsewhere(approach):
        return decision
    if is_likely_enough(record, state.target, config):
        return _found(approach, "likely enough after all looks at it")
    if record.id == state.here.accepted_object:
        return _accepted(approach)
    _dismiss(context, record, "the robot's own views didn't confirm it")
    return None


def _look_from_elsewhere(approach: _Approach) -> Decision | None:
    """Goes to another place near an object that the robot didn't see, or that isn't sure to be something else.

    None: nothing is left to be doubted, it looked from enough places, no way leads to another, or it is too long. An object
    that is accepted as a last resort isn't doubted.
    """
    context, record = approach.context, approach.record
    memory, robot, config = context.state.here, context.robot, context.config
    looked_from = (*memory.looked_from.get(record.id, ()), (robot.x_m, robot.y_m))
    if len(looked_from) >= config.max_look_places or config.verification == "paper" or not _is_undecided(approach):
        return None
    region = context.reach.goal_region(record, looked_from)
    if region is None or float(context.travel_time_m[region.goals].min(initial=math.inf)) > _ELSEWHERE_WITHIN_M:
        return None
    decision = _drive_nearer(approach, region)
    if decision is not None:
        memory.record_looked_from(record.id, robot.x_m, robot.y_m)
    return decision


def _is_undecided(approach: _Approach) -> bool:
    """Whether another place may tell more: only cameras saw the object, or its chance isn't high enough to stop and not too low
    for a last resort. Not for the object that is the last resort."""
    record, config = approach.record, approach.context.config
    if record.id == approach.context.state.here.accepted_object:
        return False
    if not record.label_robot:
        return True
    likelihood, lowest = objects.chance(record, approach.context.state.target), config.last_resort_chance
    return lowest is not None and lowest <= likelihood < config.accept_chance


def _sees_from_within(context: StepContext, region: GoalRegion, distance_m: float) -> bool:
    """Whether the robot is within a distance of the object, with nothing known in between."""
    here = context.terrain.cell(context.robot.x_m, context.robot.y_m)
    return float(region.distance_m[here]) <= distance_m and bool(region.sight[here])


def _extra_looks(context: StepContext, record: ObjectRecord) -> tuple[str, ...]:
    """Actions that bring the object to other parts of the picture, beginning with a look down if it is low."""
    config, robot = context.config, context.robot
    distance_m = math.hypot(record.center_m[0] - robot.x_m, record.center_m[1] - robot.y_m)
    below_m = context.maps.floor_z_m + config.camera_height_m - record.center_m[2]
    is_low = math.atan2(below_m, max(distance_m, 0.1)) > config.turn_rad / 2 and config.max_pitch_rad >= config.turn_rad
    return ("look_down" if is_low else "turn_right", "turn_left", "turn_right", "turn_right")[: config.max_extra_looks]


def _found(approach: _Approach, why: str) -> Decision:
    return _stop(approach, f"found {_describe(approach.context, approach.record)}: {why}")


def _accepted(approach: _Approach) -> Decision:
    described, target = _describe(approach.context, approach.record), approach.context.state.target
    return _stop(approach, f"took {described} for {target!r}: weak evidence, but nothing better was found")


def _stop(approach: _Approach, message: str) -> Decision:
    decision = approach.context.decide("stop", "finished", message, approach.option)
    return replace(decision, finished=True, found=True)


def _describe(context: StepContext, record: ObjectRecord) -> str:
    """An object in words. If it is rather something else than the target, with the chance that it is the target."""
    target = context.state.target
    term = "confidence" if record.label == target else f"{target} by"
    number = record.confidence if record.label == target else objects.chance(record, target)
    return f"{record.label} {record.id} ({term} {number:.2f})"
