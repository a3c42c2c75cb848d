"""What a mission remembers: where the robot stood and bumped, and which places it gave up."""

from __future__ import annotations

import math

from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Dormant, MissionState, RobotView

#: A place given up this often stays given up.
FOR_GOOD = 2


#: A move that is cut short ends at the contact: what blocks it is the very next cell.
AHEAD_M = 0.05


def remember(state: MissionState, robot: RobotView, config: PlannerConfig) -> None:
    """Notes where the robot stands and, if its last step was cut short, what it bumped into.

    A collision shuts one heading at one place, and marks the cell ahead as one where the robot's *centre* can't go. A
    bar at the robot's rim, grown by its radius as VLN-Game's is, would close every narrow passage at the first touch.
    """
    here = robot.x_m, robot.y_m
    bumped = robot.collided
    if robot.last_action == "move_forward" and state.visited:
        bumped |= math.dist(here, state.visited[-1]) < 0.4 * config.step_m
    if bumped and robot.last_action == "move_forward":
        c, s = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
        state.collisions.append((here[0] + c * AHEAD_M, here[1] + s * AHEAD_M))
        state.bumps.append((*here, robot.yaw_rad))
    state.visited.append(here)
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


def is_dormant(state: MissionState, x_m: float, y_m: float, config: PlannerConfig) -> bool:
    """Whether a place is given up, for now or for good."""
    here = [d for d in state.dormant if math.hypot(d.x_m - x_m, d.y_m - y_m) < config.same_place_m]
    return any(d.times >= FOR_GOOD or d.until_step > state.step for d in here)


def give_up(state: MissionState, x_m: float, y_m: float, config: PlannerConfig, *, for_good: bool = False) -> None:
    """Leaves a place alone for ``dormant_steps``; for good the second time."""
    state.commitment = None
    until = state.step + config.dormant_steps
    for i, d in enumerate(state.dormant):
        if math.hypot(d.x_m - x_m, d.y_m - y_m) < config.same_place_m:
            state.dormant[i] = Dormant(d.x_m, d.y_m, FOR_GOOD if for_good else d.times + 1, until)
            return
    state.dormant.append(Dormant(x_m, y_m, FOR_GOOD if for_good else 1, until))


def revive(state: MissionState) -> bool:
    """Ends all sleeps that aren't for good; whether there was one."""
    asleep = [d for d in state.dormant if d.times < FOR_GOOD and d.until_step > state.step]
    if asleep:
        state.dormant = [
            Dormant(d.x_m, d.y_m, d.times, min(d.until_step, state.step)) if d.times < FOR_GOOD else d
            for d in state.dormant
        ]
    return bool(asleep)
