"""At an object and on the way to it: going near, looking, believing, stopping (two-level verification)."""

from __future__ import annotations

import math
from dataclasses import replace

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import Choice, StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.goal_region import GoalRegion, goal_region
from surveilnav.services.planner.core.goals.verification import Verification, good_enough, verify
from surveilnav.services.planner.core.motion.drive import bearing_error_rad, turn_towards
from surveilnav.services.planner.core.pursuit.follow import follow, level
from surveilnav.services.planner.core.state import Decision


def approach(context: StepContext, record: ObjectRecord, choice: Choice) -> Decision | None:
    """Goes near an object, looks at it on the way, and stops if it is the target. None: it was given up or dropped."""
    verification = _verified(context, record)
    if verification == "contradicted":
        memory.drop(context.state, record, f"the robot sees {record.label_robot or 'something else'}")
        return None
    region = goal_region(
        context.terrain, context.travel_time_m, record, context.robot, context.config, context.maps.floor_z_m
    )
    if region is None:
        if objects.is_confirmed(record, context.state.target):
            memory.note_unreachable(context.state, record)
        memory.blacklist(context.state, *record.center_m[:2], context.config)
        return None
    if _has_arrived(context, region):
        return _look_and_decide(context, record, choice, verification)
    return (
        level(context, choice)
        or _turn_to_unsure(context, record, choice, region, verification)
        or _drive_to(context, record, choice, region, verification)
    )


def _verified(context: StepContext, record: ObjectRecord) -> Verification:
    """What the joint map says now. Of an accepted last resort that was ruled out before, more of the views that disagreed
    decide nothing."""
    verification = verify(record, context.state.target, context.config)
    accepted = record.id == context.state.here.accepted_object
    if verification == "contradicted" and accepted and objects.was_ruled_out(record, context.state, context.config):
        return "open"
    return verification


def _has_arrived(context: StepContext, region: GoalRegion) -> bool:
    here = context.terrain.cell(context.robot.x_m, context.robot.y_m)
    near = float(region.distance_m[here]) <= max(context.config.stop_m, region.nearest_m)
    return bool(region.goals[here]) or (near and bool(region.sight[here]))


def _turn_to_unsure(
    context: StepContext, record: ObjectRecord, choice: Choice, region: GoalRegion, verification: Verification
) -> Decision | None:
    """On the way, turns to an object near by that isn't verified, as long as it hasn't been seen from near by."""
    state, config, most = context.state, context.config, context.config.scan_turns // 2
    here = context.terrain.cell(context.robot.x_m, context.robot.y_m)
    near = float(region.distance_m[here]) <= config.inspect_m and bool(region.sight[here])
    if verification == "verified" or not near:
        return None
    off_rad = bearing_error_rad(context.robot, *record.center_m[:2])
    if abs(off_rad) <= config.half_fov_rad:  # seen from near by: turning back to it on the way is of no use
        memory.note_inspection(state, record, most)
        return None
    spent = state.here.inspected.get(record.id, 0)
    if spent >= most:
        return None
    memory.note_inspection(state, record, spent + 1)
    turn = "turn_left" if off_rad > 0 else "turn_right"
    return context.decide(turn, "confirming", f"turning to {_name(context, record)}", choice)


def _drive_to(
    context: StepContext, record: ObjectRecord, choice: Choice, region: GoalRegion, verification: Verification
) -> Decision | None:
    """A step nearer; where no way leads nearer, believes what it can from here."""
    route = follow(context, region.goals)
    if route is not None:
        message = f"to {_name(context, record)}, {route.remaining_m:.1f} m"
        return context.decide(route.action, "approaching", message, choice, route)
    here = context.terrain.cell(context.robot.x_m, context.robot.y_m)
    near = float(region.distance_m[here]) <= context.config.farthest_stop_m and bool(region.sight[here])
    if near and verification == "verified":
        return _found(
            context, f"found {_name(context, record)}: seen by the robot itself, and no way leads nearer", choice
        )
    accepted = record.id == context.state.here.accepted_object
    return _accepted(context, record, choice) if near and accepted else None


def _look_and_decide(
    context: StepContext, record: ObjectRecord, choice: Choice, verification: Verification
) -> Decision | None:
    """At the object: faces it; stops if verified, else looks from a few more directions and then decides."""
    state, config = context.state, context.config
    memory.rest(state)
    spent = state.here.looks.get(record.id, 0)
    turn = turn_towards(context.robot, *record.center_m[:2], config)
    waited = state.step - state.waypoint.best_step if state.waypoint is not None else 0
    if turn and waited < config.patience_steps and (verification == "verified" or spent == 0):
        return context.decide(turn, "confirming", f"turning to {_name(context, record)}", choice)
    if verification == "verified":
        return _found(context, f"found {_name(context, record)}: seen by the robot itself", choice)
    looks = _looks(context, record)
    if spent < len(looks) and config.verification != "paper":
        memory.note_look(state, record)
        message = f"looking at {_name(context, record)} again, {spent + 1} of {len(looks)}"
        return context.decide(looks[spent], "confirming", message, choice)
    if good_enough(record, state.target, config):
        return _found(context, f"found {_name(context, record)}: likely enough after all looks at it", choice)
    if record.id == state.here.accepted_object:
        return _accepted(context, record, choice)
    memory.drop(state, record, "the robot's own views didn't confirm it")
    return None


def _looks(context: StepContext, record: ObjectRecord) -> tuple[str, ...]:
    """Actions that show an object from other sides of the picture, down first if it is low."""
    config, robot = context.config, context.robot
    away_m = math.hypot(record.center_m[0] - robot.x_m, record.center_m[1] - robot.y_m)
    drop_m = context.maps.floor_z_m + config.camera_height_m - record.center_m[2]
    low = math.atan2(drop_m, max(away_m, 0.1)) > config.turn_rad / 2
    return ("look_down" if low else "turn_right", "turn_left", "turn_right", "turn_right")[: config.max_looks]


def _found(context: StepContext, message: str, choice: Choice) -> Decision:
    return replace(context.decide("stop", "finished", message, choice), finished=True, found=True)


def _accepted(context: StepContext, record: ObjectRecord, choice: Choice) -> Decision:
    target = context.state.target
    return _found(
        context, f"took {_name(context, record)} for {target!r}: weak evidence, but nothing better was found", choice
    )


def _name(context: StepContext, record: ObjectRecord) -> str:
    """An object in words: of one that is rather something else, how likely it is the target all the same."""
    target = context.state.target
    said = "confidence" if record.label == target else f"{target} by"
    sure = record.confidence if record.label == target else objects.chance(record, target)
    return f"{record.label} {record.id} ({said} {sure:.2f})"
