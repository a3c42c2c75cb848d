"""How the simulated robot moves: Habitat's discrete actions, without noise.

One action at a time, exactly as far as commanded. A move that meets an obstacle ends at the contact and is reported as a
collision; the robot doesn't slide along the wall. Stairs are an action of their own, ``take_stairs``: a wheeled robot can't
climb those of the homes that we have, so the action stands for a lift or a climbing robot, and costs the stair's length in
path and steps.
"""

from __future__ import annotations

import math
from dataclasses import replace

from surveilnav.messages import ACTIONS, Stair
from surveilnav.robot_body import LOOK_RAD, MAX_PITCH_RAD, STAIR_REACH_M, STEP_M, TURN_RAD
from surveilnav.robot_state import RobotState
from surveilnav.simulator.world.distance_field import Transit
from surveilnav.simulator.world.navigation import NavigationMap

#: The robot stops this far before a contact, so that it never stands in the blocked cell itself.
_CLEARANCE_M = 1e-3


def stairs_in(navigation: NavigationMap) -> list[Stair]:
    """All stairs of the building, once for each direction."""
    return [
        Stair(
            floor=floor,
            to_floor=transit.other_floor(floor),
            at_m=transit.end_on(floor),
            to_m=transit.end_on(transit.other_floor(floor)),
            length_m=transit.length_m,
        )
        for transit in navigation.transits
        for floor in _floors_of(transit)
    ]


def refusal(state: RobotState, action: str, navigation: NavigationMap, to_floor: str | None = None) -> str:
    """Why the robot can't carry out an action at all, as a sentence for people; empty if it can."""
    if action not in ACTIONS:
        return f"unknown action {action!r}; there are {', '.join(ACTIONS)}"
    if action == "drive_to":
        return "this robot moves by discrete actions, so it can't drive to a waypoint by itself"
    if action != "take_stairs" or _transit_to(state, navigation, to_floor) is not None:
        return ""
    reachable = sorted({t.other_floor(state.floor) for t in navigation.transits if state.floor in _floors_of(t)})
    if to_floor not in reachable:
        return f"no stair leads from floor {state.floor!r} to {to_floor!r}; stairs lead to {reachable or 'nowhere'}"
    return f"take_stairs needs the end of a stair to floor {to_floor!r} within {STAIR_REACH_M} m of the robot"


def act(state: RobotState, action: str, navigation: NavigationMap, to_floor: str | None = None) -> RobotState:
    """The state after one action.

    Raises:
        ValueError: the action can't be carried out; ``refusal`` says so beforehand.
    """
    reason = refusal(state, action, navigation, to_floor)
    if reason:
        raise ValueError(reason)
    done = replace(
        state, seq=state.seq + 1, steps=state.steps + 1, collided=False, stopped=action == "stop", last_action=action
    )
    if action == "move_forward":
        return _move_forward(done, navigation)
    if action == "turn_left":
        return replace(done, yaw_rad=_wrapped(state.yaw_rad + TURN_RAD))
    if action == "turn_right":
        return replace(done, yaw_rad=_wrapped(state.yaw_rad - TURN_RAD))
    if action == "look_up":
        return replace(done, pitch_rad=min(MAX_PITCH_RAD, state.pitch_rad + LOOK_RAD))
    if action == "look_down":
        return replace(done, pitch_rad=max(-MAX_PITCH_RAD, state.pitch_rad - LOOK_RAD))
    if action == "take_stairs":
        return _take_stairs(done, navigation, to_floor)
    return done


def _move_forward(state: RobotState, navigation: NavigationMap) -> RobotState:
    """0.25 m ahead, or up to the first contact."""
    dx, dy = STEP_M * math.cos(state.yaw_rad), STEP_M * math.sin(state.yaw_rad)
    share = navigation.way_free(state.p_world, (state.x_m + dx, state.y_m + dy), state.floor)
    collided = share < 1.0
    if collided:
        share = max(0.0, share - _CLEARANCE_M / STEP_M)
        # Right at a corner, the place a millimetre back may still be blocked: then the robot doesn't move at all.
        if not navigation.is_navigable((state.x_m + share * dx, state.y_m + share * dy), state.floor):
            share = 0.0
    return replace(
        state,
        x_m=state.x_m + share * dx,
        y_m=state.y_m + share * dy,
        path_m=state.path_m + share * STEP_M,
        collided=collided,
    )


def _take_stairs(state: RobotState, navigation: NavigationMap, to_floor: str | None) -> RobotState:
    """At the other end of the stair, with the same heading. The way to its near end counts, too."""
    transit = _transit_to(state, navigation, to_floor)
    assert transit is not None  # refusal() was asked before
    assert to_floor is not None
    near, far = transit.end_on(state.floor), transit.end_on(to_floor)
    length_m = math.hypot(near[0] - state.x_m, near[1] - state.y_m) + transit.length_m
    return replace(
        state,
        x_m=far[0],
        y_m=far[1],
        z_m=far[2],
        floor=to_floor,
        path_m=state.path_m + length_m,
        steps=state.steps - 1 + max(1, math.ceil(length_m / STEP_M - 1e-9)),
    )


def _transit_to(state: RobotState, navigation: NavigationMap, to_floor: str | None) -> Transit | None:
    """The nearest stair to ``to_floor`` whose end is within reach along a free straight line, or None."""
    best, best_m = None, STAIR_REACH_M
    for transit in navigation.transits:
        if state.floor not in _floors_of(transit) or transit.other_floor(state.floor) != to_floor:
            continue
        end = transit.end_on(state.floor)
        distance_m = math.hypot(end[0] - state.x_m, end[1] - state.y_m)
        # The line must be free: the stair may start behind a wall or a banister.
        if distance_m <= best_m and navigation.way_free(state.p_world, end, state.floor) >= 1.0:
            best, best_m = transit, distance_m
    return best


def _floors_of(transit: Transit) -> tuple[str, str]:
    return transit.lower_floor, transit.upper_floor


def _wrapped(yaw_rad: float) -> float:
    return math.pi - (math.pi - yaw_rad) % (2 * math.pi)
