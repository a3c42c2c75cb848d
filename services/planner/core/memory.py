"""Everything that changes what a mission remembers: where it is, where it goes, and which places it gave up.

Whatever is counted here bounds the search: tries at a place, looks at an object, peeks past a frontier, tries at a stair.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from surveilnav.messages import Candidate, ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.state import (
    BlacklistEntry,
    CurrentWaypoint,
    Decision,
    FloorChange,
    FloorGoal,
    FloorMemory,
    MissionState,
    RobotView,
)

#: A place given up this often stays so; one where a confirmed target is gets more tries.
FOR_GOOD = 2
FOR_GOOD_CONFIRMED = 4
#: A move that is cut short ends at the contact: what blocks it is the very next cell.
AHEAD_M = 0.05
#: Progress is what brings the robot nearer by this.
_PROGRESS_M = 0.1


# --- where the robot is -------------------------------------------------------------------------------------------


def arrive(state: MissionState, robot: RobotView) -> None:
    """Notes the robot's floor: what belongs to the way on the old one is forgotten, the old floor's memory kept.

    A stair that was to be taken while the robot is still on the same floor was refused.
    """
    taking, state.taking = state.taking, None
    if state.floor == robot.floor:
        if taking is not None:
            fail_stair(state, *taking[:2])
            state.step -= taking[2] - 1
        return
    if state.floor:
        why = state.floor_goal.why if taking and state.floor_goal else "it was taken there"
        state.changes.append(FloorChange(state.step, state.floor, robot.floor, why))
    else:
        del state.floors[""]
    state.floor = robot.floor
    state.floors.setdefault(robot.floor, FloorMemory()).visits += 1
    state.waypoint, state.anchor, state.escapes, state.peeks, state.second_look_left = None, None, 0, 0, 0
    if state.floor_goal and state.floor_goal.to_floor == robot.floor:
        state.floor_goal = None


def remember(state: MissionState, robot: RobotView, config: PlannerConfig) -> None:
    """Notes where the robot stands and, if its last step was cut short, what it bumped into.

    A collision shuts one heading at one place, and marks the cell ahead as one where the robot's *centre* can't go. A
    bar at the robot's rim, grown by its radius as VLN-Game's is, would close every narrow passage at the first touch.
    """
    here = robot.x_m, robot.y_m
    bumped = robot.collided
    if robot.last_action == "move_forward" and state.here.visited:
        bumped |= math.dist(here, state.here.visited[-1]) < 0.4 * config.step_m
    if bumped and robot.last_action == "move_forward":
        c, s = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
        state.here.collisions.append((here[0] + c * AHEAD_M, here[1] + s * AHEAD_M))
        state.here.bumps.append((*here, robot.yaw_rad))
    state.here.visited.append(here)
    if state.anchor is None or math.dist(here, state.anchor[:2]) >= 0.8 * config.step_m:
        state.anchor = (*here, state.step)
        state.escapes = 0


def note_decision(state: MissionState, decision: Decision) -> None:
    """Counts the action decided on, and whether it ends the mission."""
    state.finished |= decision.finished
    state.step += decision.action is not None


def reopen(state: MissionState) -> None:
    """The robot didn't carry out the stop that was to end the mission: it goes on."""
    state.finished = False


def rest(state: MissionState) -> None:
    """The robot stands still on purpose: that is not being stuck."""
    if state.anchor is not None:
        state.anchor = (*state.anchor[:2], state.step)


def is_stuck(state: MissionState, config: PlannerConfig) -> bool:
    """No way gained for ``stuck_steps`` steps in which the robot wanted to move."""
    return state.anchor is not None and state.step - state.anchor[2] >= config.stuck_steps


def escape(state: MissionState, config: PlannerConfig) -> None:
    """Turns to another waypoint for a while, every other time with the collisions forgotten: they teach the robot where
    a narrow place lets it through, but may also be what shuts it in."""
    state.escapes += 1
    held = state.waypoint
    if held is not None and held.kind != "stairs":
        tried = next((e.times for e in state.here.blacklist if _near(e, held.x_m, held.y_m, config)), 0)
        blacklist(state, held.x_m, held.y_m, config, times=max(1, tried))
    else:
        give_up_waypoint(state, config)
    if state.escapes % 2 == 0:
        state.here.collisions.clear()
        state.here.bumps.clear()
    rest(state)


# --- where it goes ------------------------------------------------------------------------------------------------


def commit(state: MissionState, chosen: Candidate, config: PlannerConfig, *, unpromising: bool = False) -> None:
    """Notes the waypoint chosen; patience starts anew only for another place."""
    held = state.waypoint
    if held is not None and _same(held, chosen, 1.5 * config.same_place_m):
        state.waypoint = replace(held, kind=chosen.kind, x_m=chosen.x_m, y_m=chosen.y_m)
        return
    state.peeks = 0
    state.waypoint = CurrentWaypoint(
        chosen.kind, chosen.x_m, chosen.y_m, None, state.step, chosen.object_id, unpromising
    )


def note_way(state: MissionState, remaining_m: float | None, config: PlannerConfig) -> bool:
    """Notes how far it still is to the waypoint; None: no way leads there. False: that, or too long without progress, and
    the waypoint is given up."""
    held = state.waypoint
    assert held is not None
    best_m = math.inf if held.best_m is None else held.best_m
    if remaining_m is not None and remaining_m > best_m + config.detour_m and held.detours < config.max_detours:
        # the map showed that the way is longer: what was gained on the old one says nothing about the new one
        held = replace(held, best_m=None, detours=held.detours + 1)
    if remaining_m is not None and (held.best_m is None or remaining_m < held.best_m - _PROGRESS_M):
        state.waypoint = replace(held, best_m=remaining_m, best_step=state.step)
    elif remaining_m is None or state.step - held.best_step > config.patience_steps:
        if held.kind == "target":
            place = f"({held.x_m:.1f}, {held.y_m:.1f})"
            state.unreachable = f"{state.target!r} was seen at {place}, but the robot can't get near it"
        give_up_waypoint(state, config)
        return False
    return True


def put_off(state: MissionState, x_m: float, y_m: float) -> None:
    """Notes a frontier that is hard to get to: it is left for the end."""
    state.here.put_off.append((x_m, y_m))


def note_wavering(state: MissionState) -> None:
    """The object that the robot was on its way to ceased to be promising."""
    assert state.waypoint is not None
    assert state.waypoint.object_id is not None
    wavered, object_id = state.here.wavered, state.waypoint.object_id
    wavered[object_id] = wavered.get(object_id, 0) + 1
    state.waypoint = None


def give_up_waypoint(state: MissionState, config: PlannerConfig) -> None:
    """Gives up the present waypoint, if there is one: a place for a while, a stair by one of its tries."""
    held = state.waypoint
    if held is None:
        return
    if held.kind == "stairs":
        fail_stair(state, held.x_m, held.y_m)
    else:
        blacklist(state, held.x_m, held.y_m, config)


def note_peek(state: MissionState) -> None:
    """Notes a turn to what a frontier hides."""
    state.peeks += 1


def note_inspection(state: MissionState, record: ObjectRecord, turns: int) -> None:
    """Notes how many turns were spent on looking at an object from near by."""
    state.here.inspected[record.id] = turns


def note_look(state: MissionState, record: ObjectRecord) -> None:
    """Notes another look at an object from where the robot stands."""
    state.here.looks[record.id] = state.here.looks.get(record.id, 0) + 1


def note_unreachable(state: MissionState, record: ObjectRecord) -> None:
    """Notes that no way leads near a confirmed target, for the final word."""
    x, y, _ = record.center_m
    state.unreachable = f"{state.target!r} was seen at ({x:.1f}, {y:.1f}), but no way leads near it"


def drop(state: MissionState, record: ObjectRecord, why: str) -> None:
    """Notes that an object isn't the target."""
    if record.id == state.here.accepted_object:
        state.here.accepted_object = None
    state.here.dropped[record.id] = (record.center_m[0], record.center_m[1], why)
    state.waypoint = None


def accept_last_resort(state: MissionState, record: ObjectRecord | None, config: PlannerConfig) -> bool:
    """Has an object taken for the target on weaker evidence; whether that is news. None: there is none any more."""
    if record is not None and record.id == state.here.accepted_object:
        return False
    state.here.accepted_object = record.id if record else None
    if record is None:
        return False
    wake(state, *record.center_m[:2], config)
    return True


# --- looking around -----------------------------------------------------------------------------------------------


def skip_scan(state: MissionState) -> None:
    """There is no first look around on this floor."""
    state.here.scan_left = 0


def begin_scan(state: MissionState, robot: RobotView, turns: int) -> None:
    """The first look around on this floor begins here."""
    state.here.scan_left = turns
    note_scan(state, robot.x_m, robot.y_m)


def continue_scan(state: MissionState) -> None:
    """Notes a turn of the first look around."""
    assert state.here.scan_left is not None
    state.here.scan_left -= 1
    rest(state)


def note_scan(state: MissionState, x_m: float, y_m: float) -> None:
    """Notes a place where the robot looked all around, or that it can't look from."""
    state.here.scans.append((x_m, y_m))


def set_second_look(state: MissionState, turns_left: int) -> None:
    """So many turns of the second look around are left."""
    state.second_look_left = turns_left


# --- floors -------------------------------------------------------------------------------------------------------


def set_floor_goal(state: MissionState, goal: FloorGoal | None) -> None:
    """The floor that the robot goes to from now on; None: it stays."""
    state.floor_goal = goal


def note_exhausted(state: MissionState, reserve: float) -> None:
    """Nothing is left to explore or to look at on this floor. ``reserve``: chance of the likeliest object left."""
    state.here.exhausted = True
    state.here.reserve = reserve


def take_stairs(state: MissionState, x_m: float, y_m: float, n_steps: int) -> None:
    """Notes that the robot is told to take the stair that ends here, which counts as ``n_steps``."""
    state.taking = x_m, y_m, n_steps
    state.step += n_steps - 1
    rest(state)


def stair_name(x_m: float, y_m: float) -> str:
    """What a stair of the present floor is called: the place of its end here."""
    return f"({x_m:.1f}, {y_m:.1f})"


def fail_stair(state: MissionState, x_m: float, y_m: float) -> None:
    """Notes that a stair couldn't be reached or taken."""
    state.waypoint = None
    name = stair_name(x_m, y_m)
    state.here.stairs_failed[name] = state.here.stairs_failed.get(name, 0) + 1


# --- the blacklist ------------------------------------------------------------------------------------------------


def blacklist(state: MissionState, x_m: float, y_m: float, config: PlannerConfig, *, times: int | None = None) -> None:
    """Leaves a place alone for ``blacklist_steps``; for good the second time. ``times``: counts it as so often."""
    state.waypoint = None
    until, entries = state.step + config.blacklist_steps, state.here.blacklist
    for i, e in enumerate(entries):
        if _near(e, x_m, y_m, config):
            entries[i] = BlacklistEntry(e.x_m, e.y_m, e.times + 1 if times is None else times, until)
            return
    entries.append(BlacklistEntry(x_m, y_m, times or 1, until))


def is_blacklisted(
    state: MissionState, x_m: float, y_m: float, config: PlannerConfig, *, confirmed: bool = False
) -> bool:
    """Whether a place is left alone, for now or for good. ``confirmed``: a confirmed target is there."""
    for_good = FOR_GOOD_CONFIRMED if confirmed else FOR_GOOD
    here = [e for e in state.here.blacklist if _near(e, x_m, y_m, config)]
    return any(e.times >= for_good or e.until_step > state.step for e in here)


def is_given_up(state: MissionState, x_m: float, y_m: float, config: PlannerConfig, *, confirmed: bool) -> bool:
    """Whether a place is left alone for good."""
    for_good = FOR_GOOD_CONFIRMED if confirmed else FOR_GOOD
    return any(e.times >= for_good for e in state.here.blacklist if _near(e, x_m, y_m, config))


def wake(state: MissionState, x_m: float, y_m: float, config: PlannerConfig) -> None:
    """Ends the time for which a place is left alone."""
    _wake(state, [i for i, e in enumerate(state.here.blacklist) if _near(e, x_m, y_m, config)])


def wake_all(state: MissionState) -> bool:
    """Ends it for all places that may not be left alone for good; whether there was one."""
    entries = enumerate(state.here.blacklist)
    asleep = [i for i, e in entries if e.times < FOR_GOOD_CONFIRMED and e.until_step > state.step]
    _wake(state, asleep)
    return bool(asleep)


def _wake(state: MissionState, entries: Iterable[int]) -> None:
    for i in entries:
        e = state.here.blacklist[i]
        state.here.blacklist[i] = replace(e, until_step=min(e.until_step, state.step))


def _near(e: BlacklistEntry, x_m: float, y_m: float, config: PlannerConfig) -> bool:
    return math.hypot(e.x_m - x_m, e.y_m - y_m) < config.same_place_m


def _same(held: CurrentWaypoint, chosen: Candidate, near_m: float) -> bool:
    """Whether a waypoint is the one held: the same object, or about the same place for the same purpose."""
    if held.object_id is not None or chosen.object_id is not None:
        return held.object_id == chosen.object_id
    purpose = (held.kind == "stairs") == (chosen.kind == "stairs")
    return purpose and math.hypot(held.x_m - chosen.x_m, held.y_m - chosen.y_m) <= near_m
