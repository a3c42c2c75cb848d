"""What the planner's core is given at each step: the joint maps of the robot's floor, and the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.messages import ObjectRecord, RobotStatus, Stair, WaypointStatus
from surveilnav.services.planner.core.motion.areas import Area


@dataclass(frozen=True, slots=True, eq=False)
class FloorMaps:
    """The joint maps of one floor at one revision.

    Attributes:
        floor: the floor's id; ``floor_z_m``: its altitude [m].
        grid: frame of all layers; each layer is (rows, cols).
        occupancy: uint8, 0, or one of the values in ``surveilnav.occupancy``.
        explored, frontier: uint8, 0 or 1.
        value: float32, relevance to the mission's target; NaN where unknown.
        revision: the number of this state of the maps.
        pending_views: how many views of this floor's cameras haven't been integrated yet.
        removals: changes when what a source has contributed was taken out of the maps. Objects have other ids then.
        areas: places of this floor where no robot is sent, and its passages that are known to be open or closed.
    """

    floor: str
    floor_z_m: float
    grid: Grid
    occupancy: NDArray[np.uint8]
    explored: NDArray[np.uint8]
    frontier: NDArray[np.uint8]
    value: NDArray[np.float32]
    objects: Sequence[ObjectRecord]
    revision: int
    pending_views: int = 0
    removals: int = 0
    areas: tuple[Area, ...] = ()


@dataclass(frozen=True, slots=True)
class RobotView:
    """The robot at observation ``seq``: (x, y) [m, world], yaw and camera pitch (> 0 looks up) [rad].

    ``stairs``: all stairs (or lifts) of the building that it can take, in both directions. ``waypoint``: how far it has come with
    the waypoint of its last ``drive_to``.
    """

    seq: int
    x_m: float
    y_m: float
    yaw_rad: float
    pitch_rad: float
    floor: str
    collided: bool
    last_action: str | None
    path_m: float
    stairs: tuple[Stair, ...] = ()
    waypoint: WaypointStatus | None = None

    @classmethod
    def from_status(cls, status: RobotStatus, mission: str, stairs: tuple[Stair, ...]) -> RobotView:
        """The robot as its status reports it. What it did in another mission is left out."""
        x_m, y_m, _ = status.T_world_base.translation_m
        T_world_base, same_mission = status.T_world_base.matrix(), status.mission == mission
        return cls(
            status.seq,
            x_m,
            y_m,
            math.atan2(T_world_base[1, 0], T_world_base[0, 0]),
            status.pitch_rad,
            status.floor,
            collided=same_mission and status.collided,
            last_action=status.last_action if same_mission else None,
            path_m=status.path_m if same_mission else 0.0,
            stairs=stairs,
            waypoint=status.waypoint if same_mission else None,
        )
