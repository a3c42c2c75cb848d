"""What a mission remembers: where the robot stood and bumped, and which places it gave up."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Dormant, MissionState, RobotView

#: A place given up this often stays given up; one where a confirmed target is gets more tries.
FOR_GOOD = 2
FOR_GOOD_CONFIRMED = 4


#: A move that is cut short ends at the contact: what blocks it is the very next cell.
AHEAD_M = 0.05


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


def rest(state: MissionState) -> None:
    """The robot stands still on purpose: that is not being stuck."""
    if state.anchor is not None:
        state.anchor = (*state.anchor[:2], state.step)


def is_stuck(state: MissionState, config: PlannerConfig) -> bool:
    """No way gained for ``stuck_steps`` steps in which the robot wanted to move."""
    return state.anchor is not None and state.step - state.anchor[2] >= config.stuck_steps


def is_dormant(state: MissionState, x_m: float, y_m: float, config: PlannerConfig, for_good: int = FOR_GOOD) -> bool:
    """Whether a place is given up, for now or for good."""
    here = [d for d in state.here.dormant if _near(d, x_m, y_m, config)]
    return any(d.times >= for_good or d.until_step > state.step for d in here)


def give_up(state: MissionState, x_m: float, y_m: float, config: PlannerConfig, *, times: int | None = None) -> None:
    """Leaves a place alone for ``dormant_steps``; for good the second time. ``times``: counts it as so often."""
    state.commitment = None
    until, places = state.step + config.dormant_steps, state.here.dormant
    for i, d in enumerate(places):
        if _near(d, x_m, y_m, config):
            places[i] = Dormant(d.x_m, d.y_m, d.times + 1 if times is None else times, until)
            return
    places.append(Dormant(x_m, y_m, times or 1, until))


def is_given_up(state: MissionState, x_m: float, y_m: float, config: PlannerConfig, *, confirmed: bool) -> bool:
    """Whether a place of an object, a confirmed target or not, is given up for good."""
    for_good = FOR_GOOD_CONFIRMED if confirmed else FOR_GOOD
    return any(d.times >= for_good for d in state.here.dormant if _near(d, x_m, y_m, config))


def wake(state: MissionState, x_m: float, y_m: float, config: PlannerConfig) -> None:
    """Ends the sleep of a place."""
    _end_sleep(state, [i for i, d in enumerate(state.here.dormant) if _near(d, x_m, y_m, config)])


def revive(state: MissionState) -> bool:
    """Ends all sleeps that may not be for good; whether there was one. What is given up for good stays so."""
    places = enumerate(state.here.dormant)
    asleep = [i for i, d in places if d.times < FOR_GOOD_CONFIRMED and d.until_step > state.step]
    _end_sleep(state, asleep)
    return bool(asleep)


def _end_sleep(state: MissionState, places: Iterable[int]) -> None:
    for i in places:
        d = state.here.dormant[i]
        state.here.dormant[i] = replace(d, until_step=min(d.until_step, state.step))


def _near(d: Dormant, x_m: float, y_m: float, config: PlannerConfig) -> bool:
    return math.hypot(d.x_m - x_m, d.y_m - y_m) < config.same_place_m


def give_up_waypoint(state: MissionState, config: PlannerConfig) -> None:
    """Gives up the present waypoint, if there is one: a place for a while, a stair by one of its tries."""
    held = state.commitment
    if held is None:
        return
    if held.kind == "stairs":
        fail_stair(state, held.x_m, held.y_m)
    else:
        give_up(state, held.x_m, held.y_m, config)


def stair_name(x_m: float, y_m: float) -> str:
    """What a stair of the present floor is called: the place of its end here."""
    return f"({x_m:.1f}, {y_m:.1f})"


def fail_stair(state: MissionState, x_m: float, y_m: float) -> None:
    """Notes that a stair couldn't be reached or taken."""
    state.commitment = None
    name = stair_name(x_m, y_m)
    state.here.stairs_failed[name] = state.here.stairs_failed.get(name, 0) + 1


def escape(state: MissionState, config: PlannerConfig) -> None:
    """Turns to another waypoint for a while, every other time with the collisions forgotten: they teach the robot where
    a narrow place lets it through, but may also be what shuts it in."""
    state.escapes += 1
    held = state.commitment
    if held is not None and held.kind != "stairs":
        tried = next((d.times for d in state.here.dormant if _near(d, held.x_m, held.y_m, config)), 0)
        give_up(state, held.x_m, held.y_m, config, times=max(1, tried))
    else:
        give_up_waypoint(state, config)
    if state.escapes % 2 == 0:
        state.here.collisions.clear()
        state.here.bumps.clear()
    rest(state)
