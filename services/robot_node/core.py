"""The motion of a simulated robot, by Habitat's rules.

One action at a time, exact: no noise, no sliding along walls. A move that meets something ends at the contact and says
so. A stair is an action of its own: too steep for wheels in the homes we have, it stands for a lift or a climbing
robot, and is counted by its length in path and steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from numpy.typing import ArrayLike

from surveilnav.geometry import Matrix4, Pinhole, Pose, base_pose, camera_pose
from surveilnav.messages import ACTIONS, RobotStatus, Stair
from surveilnav.robot_body import CAMERA_HEIGHT_M, LOOK_RAD, STAIR_REACH_M, STEP_M, TURN_RAD

StateName = Literal["ready", "moving", "stopped", "halted", "error"]

MAX_PITCH_RAD = math.radians(60.0)
#: Habitat's ObjectNav sensor: 640x480 at 79 degrees.
CAMERA = Pinhole.from_hfov(640, 480, math.radians(79.0))
#: A robot stops this far before a contact, so that it never stands in the blocked cell itself.
_CLEARANCE_M = 1e-3


class TransitLike(Protocol):
    """A stair: see ``surveilnav.simulator.world.navigation.Transit``."""

    @property
    def length_m(self) -> float:
        """Length of the way between its ends."""
        ...

    @property
    def lower_floor(self) -> str:
        """The floor of its lower end."""
        ...

    @property
    def upper_floor(self) -> str:
        """The floor of its upper end."""
        ...

    def end_on(self, floor: str) -> tuple[float, float, float]:
        """Its end (x, y, z) on one of its floors [m, world]."""
        ...

    def other_floor(self, floor: str) -> str:
        """The floor that it leads to from ``floor``."""
        ...


class NavigationLike(Protocol):
    """What motion needs to know of the world: see ``surveilnav.simulator.world.navigation.NavigationMap``."""

    @property
    def transits(self) -> tuple[TransitLike, ...]:
        """All stairs."""
        ...

    def is_navigable(self, p_world: ArrayLike, floor: str) -> bool:
        """Whether a robot can stand at ``p_world`` (x, y[, z])."""
        ...

    def way_free(self, p_from: ArrayLike, p_to: ArrayLike, floor: str) -> float:
        """The share of the straight way that is free, 0-1."""
        ...


@dataclass(frozen=True, slots=True)
class RobotState:
    """Where a robot is and how it got there.

    ``x_m``, ``y_m``, ``z_m``: its base on the floor, in the world; ``yaw_rad`` anticlockwise from +x, in (-pi, pi];
    ``pitch_rad`` of the camera, up positive; ``seq`` grows by one with every action; ``steps`` likewise, but a stair
    counts as many as moves of its length; ``path_m``: sum of displacements since the mission began; ``collided``: the
    last move was cut short; ``stopped``: the last action was stop; ``mission``: the one that it last obeyed.
    """

    x_m: float
    y_m: float
    z_m: float
    floor: str
    yaw_rad: float
    pitch_rad: float = 0.0
    seq: int = 0
    steps: int = 0
    path_m: float = 0.0
    collided: bool = False
    stopped: bool = False
    last_action: str | None = None
    mission: str = ""

    @property
    def p_world(self) -> tuple[float, float, float]:
        """(x, y, z) of its base [m, world]."""
        return self.x_m, self.y_m, self.z_m


def stairs_of(navigation: NavigationLike) -> list[Stair]:
    """All stairs of the building, each in both directions."""
    return [
        Stair(
            floor=floor,
            to_floor=t.other_floor(floor),
            at_m=t.end_on(floor),
            to_m=t.end_on(t.other_floor(floor)),
            length_m=t.length_m,
        )
        for t in navigation.transits
        for floor in _floors_of(t)
    ]


@dataclass(frozen=True, slots=True)
class Halted:
    """Whether a robot was stopped by hand, and why. It stays so until it is released, whatever is commanded meanwhile."""

    halted: bool = False
    reason: str = ""

    def refusal(self, action: str) -> str:
        """Why an action isn't carried out, for people; empty if it is. To stop is always allowed."""
        if not self.halted or action == "stop":
            return ""
        return f"the robot is halted ({self.reason or 'no reason was given'}): release it first"


def state_name(state: RobotState, halted: Halted, *, late: bool, awaiting: bool) -> StateName:
    """What the robot says that it does. ``late``: no command came in time; ``awaiting``: the next one is expected."""
    if halted.halted:
        return "halted"
    return "stopped" if state.stopped or late else "moving" if awaiting else "ready"


def status_of(
    state: RobotState,
    *,
    robot: str,
    kind: StateName = "ready",
    message: str = "",
    stairs: Sequence[Stair] = (),
    notes: Sequence[str] = (),
    stamp_ns: int = 0,
) -> RobotStatus:
    """What the robot says of itself on the bus."""
    return RobotStatus(
        stamp_ns=stamp_ns,
        robot=robot,
        floor=state.floor,
        seq=state.seq,
        state=kind,
        pitch_rad=state.pitch_rad,
        T_world_base=Pose.from_matrix(base_pose_of(state)),
        message=message,
        stairs=list(stairs),
        notes=list(notes),
        mission=state.mission,
        collided=state.collided,
        last_action=state.last_action,  # type: ignore[arg-type]
        path_m=state.path_m,
    )


def begin_mission(state: RobotState, mission: str) -> RobotState:
    """The same place with path and steps at zero and nothing done; ``seq`` goes on."""
    return replace(state, path_m=0.0, steps=0, collided=False, stopped=False, last_action=None, mission=mission)


def refusal(state: RobotState, action: str, navigation: NavigationLike, to_floor: str | None = None) -> str:
    """Why an action can't be carried out at all, for people; empty if it can."""
    if action not in ACTIONS:
        return f"unknown action {action!r}; there are {', '.join(ACTIONS)}"
    if action != "take_stairs" or _transit_to(state, navigation, to_floor) is not None:
        return ""
    reachable = sorted({t.other_floor(state.floor) for t in navigation.transits if state.floor in _floors_of(t)})
    if to_floor not in reachable:
        return f"no stair leads from floor {state.floor!r} to {to_floor!r}; stairs lead to {reachable or 'nowhere'}"
    return f"take_stairs needs the end of a stair to floor {to_floor!r} within {STAIR_REACH_M} m of the robot"


def act(state: RobotState, action: str, navigation: NavigationLike, to_floor: str | None = None) -> RobotState:
    """The state after one action.

    Raises:
        ValueError: the action can't be carried out; ask ``refusal`` first.
    """
    reason = refusal(state, action, navigation, to_floor)
    if reason:
        raise ValueError(reason)
    done = replace(
        state, seq=state.seq + 1, steps=state.steps + 1, collided=False, stopped=action == "stop", last_action=action
    )
    if action == "move_forward":
        return _moved(done, navigation)
    if action == "turn_left":
        return replace(done, yaw_rad=_wrapped(state.yaw_rad + TURN_RAD))
    if action == "turn_right":
        return replace(done, yaw_rad=_wrapped(state.yaw_rad - TURN_RAD))
    if action == "look_up":
        return replace(done, pitch_rad=min(MAX_PITCH_RAD, state.pitch_rad + LOOK_RAD))
    if action == "look_down":
        return replace(done, pitch_rad=max(-MAX_PITCH_RAD, state.pitch_rad - LOOK_RAD))
    if action == "take_stairs":
        return _over_stairs(done, navigation, to_floor)
    return done


def _moved(state: RobotState, navigation: NavigationLike) -> RobotState:
    """0.25 m ahead, or up to the first contact."""
    dx, dy = STEP_M * math.cos(state.yaw_rad), STEP_M * math.sin(state.yaw_rad)
    share = navigation.way_free(state.p_world, (state.x_m + dx, state.y_m + dy), state.floor)
    collided = share < 1.0
    if collided:
        share = max(0.0, share - _CLEARANCE_M / STEP_M)
        # Right at a corner a millimetre back may still be blocked: then it doesn't move.
        if not navigation.is_navigable((state.x_m + share * dx, state.y_m + share * dy), state.floor):
            share = 0.0
    return replace(
        state,
        x_m=state.x_m + share * dx,
        y_m=state.y_m + share * dy,
        path_m=state.path_m + share * STEP_M,
        collided=collided,
    )


def _over_stairs(state: RobotState, navigation: NavigationLike, to_floor: str | None) -> RobotState:
    """To the other end of the stair, facing as before; the way to its near end counts too."""
    transit = _transit_to(state, navigation, to_floor)
    assert transit is not None  # refusal() has seen to it
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


def _transit_to(state: RobotState, navigation: NavigationLike, to_floor: str | None) -> TransitLike | None:
    """The nearest stair to ``to_floor`` with its end within reach and in a straight line, or None."""
    best, best_m = None, STAIR_REACH_M
    for transit in navigation.transits:
        if state.floor not in _floors_of(transit) or transit.other_floor(state.floor) != to_floor:
            continue
        end = transit.end_on(state.floor)
        away_m = math.hypot(end[0] - state.x_m, end[1] - state.y_m)
        # Not through a wall or a banister.
        if away_m <= best_m and navigation.way_free(state.p_world, end, state.floor) >= 1.0:
            best, best_m = transit, away_m
    return best


def _floors_of(transit: TransitLike) -> tuple[str, str]:
    return transit.lower_floor, transit.upper_floor


def _wrapped(yaw_rad: float) -> float:
    return math.pi - (math.pi - yaw_rad) % (2 * math.pi)


def base_pose_of(state: RobotState) -> Matrix4:
    """``T_world_base`` (4, 4): x forward, y left, z up, on the floor."""
    return base_pose(state.p_world, state.yaw_rad)


def camera_pose_of(state: RobotState, camera_height_m: float = CAMERA_HEIGHT_M) -> Matrix4:
    """``T_world_camera`` (4, 4) of the robot's camera, above the middle of its base."""
    return camera_pose((state.x_m, state.y_m, state.z_m + camera_height_m), state.yaw_rad, state.pitch_rad)
