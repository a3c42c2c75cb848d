"""Messages of robots: observations, state, commands."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav import robot_body
from surveilnav.geometry import Pose
from surveilnav.messages.base import Message
from surveilnav.messages.view import FrameHeader

ActionName = Literal[
    "move_forward", "turn_left", "turn_right", "look_up", "look_down", "stop", "take_stairs", "drive_to"
]

#: ``move_forward`` goes 0.25 m, turns and looks turn by 30 degrees, ``take_stairs`` goes to another floor by a ``Stair``.
#: ``drive_to`` sets the waypoint of a robot that drives there by itself, and returns at once.
ACTIONS: tuple[str, ...] = (
    "move_forward",
    "turn_left",
    "turn_right",
    "look_up",
    "look_down",
    "stop",
    "take_stairs",
    "drive_to",
)


class RobotDescription(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot is like and can do. The defaults are Habitat's ObjectNav robot.

    Attributes:
        drive: "actions": it moves by one discrete action at a time; "waypoints": it drives to a place by itself, as a robot
            with Nav2 does, and observes at its own pace meanwhile.
        radius_m: of its footprint, a disc; ``height_m``: the room that it needs above the floor.
        camera_height_m: height of its camera above the floor.
        hfov_rad: horizontal angle of view of its camera.
        max_pitch_rad: how far its camera tilts up and down; 0: it doesn't tilt.
    """

    drive: Literal["actions", "waypoints"] = "actions"
    radius_m: float = robot_body.RADIUS_M
    height_m: float = robot_body.HEIGHT_M
    camera_height_m: float = robot_body.CAMERA_HEIGHT_M
    hfov_rad: float = robot_body.HFOV_RAD
    max_pitch_rad: float = robot_body.MAX_PITCH_RAD


class WaypointPose(msgspec.Struct, frozen=True, kw_only=True):
    """Where a robot is to drive, (x, y) [m] on its floor, and which way it looks at the end [rad], in the world.

    ``id``: the same for a repeated command, so that the robot doesn't begin anew.
    """

    id: str
    x_m: float
    y_m: float
    yaw_rad: float


class WaypointStatus(msgspec.Struct, frozen=True, kw_only=True):
    """How far a robot has come with waypoint ``id``.

    Attributes:
        state: "failed": the robot's own navigation rejected it or gave it up; "cancelled": another command or a halt ended it.
        why: for people; empty if nothing is to be said.
        remaining_m: length of the way that is left, by the robot's own planner; None: it doesn't say.
    """

    id: str
    state: Literal["driving", "reached", "failed", "cancelled"]
    why: str = ""
    remaining_m: float | None = None


class Observation(FrameHeader, frozen=True, kw_only=True):
    """What a robot sees after its last action.

    Attributes:
        T_world_base: pose of its base on the floor, x forward, z up.
        last_action: the action that led here.
        collided: whether that action was cut short.
        path_m: distance travelled since the mission began, or since start-up.
    """

    T_world_base: Pose
    last_action: ActionName | None = None
    collided: bool = False
    path_m: float = 0.0


class Stair(msgspec.Struct, frozen=True, kw_only=True):
    """A way to another floor that a robot can take by ``take_stairs``, in one direction.

    Attributes:
        at_m, to_m: its ends (x, y, z) on the two floors, in the world.
        length_m: length of the way between them.
    """

    floor: str
    to_floor: str
    at_m: tuple[float, float, float]
    to_m: tuple[float, float, float]
    length_m: float


class RobotStatus(Message, frozen=True, kw_only=True):
    """State of a robot, at 1 Hz and on change.

    Attributes:
        seq: sequence number of its newest observation.
        state: "moving": it expects another command; "stopped": it called ``stop`` or no command came in time; "halted":
            somebody stopped it by hand, and it refuses to move until it is released.
        T_world_base: see ``Observation``.
        pitch_rad: tilt of its camera, positive upwards.
        message: details of the state, for people.
        stairs: the stairs or lifts that it can take, once for each direction.
        notes: where it can't go, for people ("robots reach 39 of 118 m²: no stair leads to level 2").
        mission: the mission whose command it carried out last.
        last_action: the action that led to ``seq``; None: none in this mission yet.
        collided: whether that action was cut short.
        path_m: distance travelled since the mission began, or since start-up.
        description: what it is like and can do.
        waypoint: how far it has come with its newest waypoint; None: it has had none.
        battery: how full its battery is, 0 to 1; None: it doesn't say.
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
    description: RobotDescription = RobotDescription()
    waypoint: WaypointStatus | None = None
    battery: float | None = None


class Command(Message, frozen=True, kw_only=True):
    """One action, valid only if the sequence number of the robot's newest observation is ``seq_expected``.

    A robot that drives to waypoints observes while it drives, so to it a command is also valid if it has newer observations.

    Attributes:
        deadline_ms: if no further command comes within this time, the robot reports itself as stopped.
        to_floor: destination of ``take_stairs``.
        mission: the mission that it belongs to.
        waypoint: destination of ``drive_to``.
        found: with ``stop``: the robot stops because it is at the target. False where a mission ends in another way.
    """

    action: ActionName
    seq_expected: int
    deadline_ms: int = 60_000
    to_floor: str | None = None
    mission: str = ""
    waypoint: WaypointPose | None = None
    found: bool = False


class CommandReply(Message, frozen=True, kw_only=True):
    """Whether a command was carried out; ``seq``: the observation that it led to, or the present one."""

    accepted: bool
    seq: int
    error: str = ""


class Halt(Message, frozen=True, kw_only=True):
    """Halts a robot at once, or releases it. A halted robot refuses every command but ``stop`` as "halted"."""

    halted: bool
    reason: str = ""


class HaltReply(Message, frozen=True, kw_only=True):
    """Whether ``robot`` is halted now."""

    robot: str
    halted: bool
