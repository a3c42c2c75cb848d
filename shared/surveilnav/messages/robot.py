"""Robots: observations, state, commands."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.geometry import Pose
from surveilnav.messages.base import Message
from surveilnav.messages.view import FrameHeader

ActionName = Literal["move_forward", "turn_left", "turn_right", "look_up", "look_down", "stop", "take_stairs"]

#: move_forward 0.25 m; turns and looks 30 degrees; take_stairs goes to another floor over a stair transit.
ACTIONS: tuple[str, ...] = (
    "move_forward",
    "turn_left",
    "turn_right",
    "look_up",
    "look_down",
    "stop",
    "take_stairs",
)


class Observation(FrameHeader, frozen=True, kw_only=True):
    """What a robot sees after its last action: a frame, and its base's pose on the floor.

    ``T_world_base``: x forward, z up, on the floor. ``last_action`` led here; ``collided`` says that it was
    cut short; ``path_m`` is the length of the way so far since ``mission`` (or since start-up).
    """

    T_world_base: Pose
    last_action: ActionName | None = None
    collided: bool = False
    path_m: float = 0.0


class Stair(msgspec.Struct, frozen=True, kw_only=True):
    """A way to another floor that a robot can take by ``take_stairs``, in one direction.

    ``at_m``, ``to_m``: its ends (x, y, z) on the two floors [m, world]; ``length_m``: of the way between them.
    """

    floor: str
    to_floor: str
    at_m: tuple[float, float, float]
    to_m: tuple[float, float, float]
    length_m: float


class RobotStatus(Message, frozen=True, kw_only=True):
    """State of a robot, at 1 Hz and on change. ``seq``: its newest observation; ``pitch_rad`` of its camera, up > 0.

    ``stairs``: the stairs (or lifts) of the building that this robot can take, in both directions.
    ``notes``: what people should know of where it can go ("robots reach 39 of 118 m²: no stair leads to level 2").
    ``mission``: the one that it last obeyed; ``last_action`` led to ``seq`` (None: nothing done in it yet); ``collided``: it was
    cut short; ``path_m``: length of the way since that mission began (or since start-up). ``halted``: somebody stopped it by
    hand, and it refuses to move until it is released.
    """

    robot: str
    floor: str
    seq: int
    state: Literal["ready", "moving", "stopped", "halted", "error"]
    T_world_base: Pose
    pitch_rad: float = 0.0
    message: str = ""
    stairs: list[Stair] = []
    notes: list[str] = []
    mission: str = ""
    collided: bool = False
    last_action: ActionName | None = None
    path_m: float = 0.0


class Command(Message, frozen=True, kw_only=True):
    """One action, valid only if the robot's newest observation is ``seq_expected``.

    ``observe`` is the sequence wanted back; ``to_floor`` belongs to take_stairs. A robot that hears no
    command within ``deadline_ms`` after this one stops.
    """

    action: ActionName
    seq_expected: int
    deadline_ms: int = 60_000
    to_floor: str | None = None
    mission: str = ""


class CommandReply(Message, frozen=True, kw_only=True):
    """Whether a command was carried out, and the observation it led to (``seq``)."""

    accepted: bool
    seq: int
    error: str = ""


class Halt(Message, frozen=True, kw_only=True):
    """Stops a robot at once (``halted``), or releases it. A halted robot refuses every command but stop, as "halted"."""

    halted: bool
    reason: str = ""


class HaltReply(Message, frozen=True, kw_only=True):
    """Whether ``robot`` is halted now."""

    robot: str
    halted: bool
