"""At a waypoint and on the way to it: driving, looking, believing, stopping."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from services.planner.core import memory, objects
from services.planner.core.drive import bearing_error_rad, turn_towards
from services.planner.core.frontiers import Frontier, unknown_side
from services.planner.core.now import Now
from services.planner.core.state import Decision, MissionState
from surveilnav.messages import ObjectRecord


def explore(now: Now, frontier: Frontier) -> Decision | None:
    """Drives to a frontier; there turns to what it hides once, and leaves it for good if it is still one."""
    state, config, robot = now.state, now.config, now.robot
    if levelled := now.level():
        return levelled
    away_m = math.hypot(frontier.x_m - robot.x_m, frontier.y_m - robot.y_m)
    if away_m <= config.reached_m:
        side = unknown_side(now.maps, now.terrain, frontier.x_m, frontier.y_m)
        turn = turn_towards(robot, *side, config) if side else None
        if turn is None or state.peeks >= config.scan_turns // 2:
            memory.give_up(state, frontier.x_m, frontier.y_m, config, times=memory.FOR_GOOD)
            return None
        state.peeks += 1
        return now.decide(turn, "exploring", "looking past a frontier")
    goals = now.terrain.disc(frontier.x_m, frontier.y_m, config.reached_m * 0.6) & np.isfinite(now.arrival)
    if not goals.any():
        goals = now.terrain.disc(frontier.x_m, frontier.y_m, config.same_place_m) & np.isfinite(now.arrival)
    route = now.drive(goals)
    if route is None:
        return None
    return now.decide(route.action, "exploring", f"to a frontier, {route.remaining_m:.1f} m", route)


def approach(now: Now, record: ObjectRecord) -> Decision | None:
    """Goes near an object, looks at it on the way, and stops if it is the target: two-level verification."""
    state, config, robot = now.state, now.config, now.robot
    judged = objects.verdict(record, state.target, config)
    settled = record.id == state.here.settled_for
    if judged == "contradicted" and settled and objects.was_judged(record, state, config):
        judged = "open"  # more of the views that disagreed before decide nothing
    if judged == "contradicted":
        _drop(state, record, f"the robot sees {record.label_robot or 'something else'}")
        return None
    place = objects.standoff(now.terrain, now.arrival, record, robot, config, now.maps.floor_z_m)
    if place is None:
        if objects.is_confirmed(record, state.target):
            x, y, _ = record.center_m
            state.unreachable = f"{state.target!r} was seen at ({x:.1f}, {y:.1f}), but no way leads near it"
        memory.give_up(state, record.center_m[0], record.center_m[1], config)
        return None
    here = now.terrain.cell(robot.x_m, robot.y_m)
    away_m = float(place.distance_m[here])
    arrived = bool(place.goals[here]) or (away_m <= max(config.stop_m, place.nearest_m) and bool(place.sight[here]))
    if arrived:
        return _confirm(now, record, judged)

    if levelled := now.level():
        return levelled
    off_rad = bearing_error_rad(robot, record.center_m[0], record.center_m[1])
    unsure = judged != "verified" and away_m <= config.inspect_m and bool(place.sight[here])
    if unsure and abs(off_rad) <= config.half_fov_rad:  # seen from near by: turning back to it on the way is of no use
        state.here.inspected[record.id] = config.scan_turns // 2
    if (
        unsure
        and abs(off_rad) > config.half_fov_rad
        and state.here.inspected.get(record.id, 0) < config.scan_turns // 2
    ):
        state.here.inspected[record.id] = state.here.inspected.get(record.id, 0) + 1
        return now.decide("turn_left" if off_rad > 0 else "turn_right", "confirming", f"turning to {_what(record)}")
    route = now.drive(place.goals)
    if route is None:
        as_near_as_it_gets = away_m <= config.farthest_stop_m and bool(place.sight[here])
        if as_near_as_it_gets and judged == "verified":
            return _found(now, f"found {_what(record)}: seen by the robot itself, and no way leads nearer")
        return _settled(now, record) if as_near_as_it_gets and settled else None
    return now.decide(route.action, "approaching", f"to {_what(record)}, {route.remaining_m:.1f} m", route)


def _confirm(now: Now, record: ObjectRecord, judged: objects.Verdict) -> Decision | None:
    """At the object: faces it; stops if verified, else looks from a few more directions and then decides."""
    state, config, robot = now.state, now.config, now.robot
    memory.rest(state)
    spent = state.here.looks.get(record.id, 0)
    turn = turn_towards(robot, record.center_m[0], record.center_m[1], config)
    commitment = state.commitment
    waited = state.step - commitment.best_step if commitment is not None else 0
    if judged == "verified":
        if turn and waited < config.patience_steps:
            return now.decide(turn, "confirming", f"turning to {_what(record)}")
        return _found(now, f"found {_what(record)}: seen by the robot itself")
    if spent == 0 and turn and waited < config.patience_steps:
        return now.decide(turn, "confirming", f"turning to {_what(record)}")
    away_m = math.hypot(record.center_m[0] - robot.x_m, record.center_m[1] - robot.y_m)
    drop_m = now.maps.floor_z_m + config.camera_height_m - record.center_m[2]
    low = math.atan2(drop_m, max(away_m, 0.1)) > config.turn_rad / 2
    looks = ("look_down" if low else "turn_right", "turn_left", "turn_right", "turn_right")[: config.max_looks]
    if spent < len(looks) and config.verification != "paper":
        state.here.looks[record.id] = spent + 1
        message = f"looking at {_what(record)} again, {spent + 1} of {len(looks)}"
        return now.decide(looks[spent], "confirming", message)
    if objects.good_enough(record, state.target, config):
        why = "strong surveillance evidence, which the robot's views don't contradict"
        return _found(now, f"found {_what(record)}: {why}")
    if record.id == state.here.settled_for:
        return _settled(now, record)
    _drop(state, record, "the robot's own views didn't confirm it")
    return None


def _found(now: Now, message: str) -> Decision:
    return replace(now.decide("stop", "finished", message), finished=True, found=True)


def _settled(now: Now, record: ObjectRecord) -> Decision:
    return _found(now, f"took {_what(record)} for {now.state.target!r}: weak evidence, but nothing better was found")


def _drop(state: MissionState, record: ObjectRecord, why: str) -> None:
    if record.id == state.here.settled_for:
        state.here.settled_for = None
    state.here.dropped[record.id] = (record.center_m[0], record.center_m[1], why)
    state.commitment = None


def _what(record: ObjectRecord) -> str:
    return f"{record.label} {record.id} (confidence {record.confidence:.2f})"
