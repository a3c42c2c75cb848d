"""The interface between the robot node and its robot, simulated or real."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.messages import RobotDescription, Stair, WaypointPose, WaypointStatus
from surveilnav.messages.view import ScanHeader
from surveilnav.robot_state import RobotState


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the robot's camera sees in one state.

    Attributes:
        state: the state in which the pictures were taken.
        T_world_camera: (4, 4) pose of the camera at that moment.
        camera: intrinsics of colour and depth, which are registered.
        mounting_offset_m: height of the camera above the floor.
        depth_range_m: (nearest, farthest) depth that the camera measures.
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) float32 [m] along the optical axis; 0 or NaN where there is none.
        scan: of its laser scanner at about that moment; None: it has none.
    """

    state: RobotState
    T_world_camera: Matrix4
    camera: Pinhole
    mounting_offset_m: float
    depth_range_m: tuple[float, float]
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    scan: ScanHeader | None = None


class Body(Protocol):
    """One robot. ``act`` and ``observe`` are called from two threads, ``halt`` from a third; two actions never overlap.

    Attributes:
        stairs: the stairs or lifts that it can take, once for each direction.
        notes: sentences for people about where it can't go, and about what is wrong with it.
    """

    stairs: Sequence[Stair]

    @property
    def description(self) -> RobotDescription:
        """What it is like, and whether it moves by actions or drives to waypoints."""
        ...

    @property
    def problem(self) -> str:
        """Why it can't be used now, for people, such as a localisation that is lost; empty if it can."""
        ...

    @property
    def waypoint(self) -> WaypointStatus | None:
        """How far it has come with its newest waypoint; None: it has none in this mission."""
        ...

    @property
    def battery(self) -> float | None:
        """How full its battery is, 0 to 1; None: it doesn't say."""
        ...

    @property
    def notes(self) -> Sequence[str]: ...

    @property
    def state(self) -> RobotState:
        """Where it is, and the outcome of its last action."""
        ...

    def refusal(self, action: str, to_floor: str | None = None) -> str:
        """Why it can't carry out an action at all, as a sentence for people; empty if it can."""
        ...

    def begin_mission(self, mission: str) -> None:
        """Starts to count path and steps for a mission; from now on ``state.mission`` is ``mission``."""
        ...

    def act(self, action: str, to_floor: str | None = None) -> None:
        """Carries out one action and returns when it has ended. Only called with actions that ``refusal`` allows."""
        ...

    def drive_to(self, waypoint: WaypointPose | None) -> None:
        """Begins to drive to a waypoint, and returns at once; the same waypoint again changes nothing. None: ends the drive."""
        ...

    def halt(self) -> None:
        """Stops the robot at once. An action in progress ends where the robot stands, and its ``act`` returns."""
        ...

    def observe(self) -> Observation | None:
        """Takes pictures in the present state. None: there are no new ones, or it isn't known where they were taken."""
        ...


class ActionBody:
    """What all bodies have in common that move by discrete actions, and are always ready."""

    description = RobotDescription()
    problem = ""
    waypoint: WaypointStatus | None = None
    battery: float | None = None

    def drive_to(self, waypoint: WaypointPose | None) -> None:
        """Nothing: it stands still between two actions."""
