"""The camera plan of a building: where its cameras are and in which directions they look."""

from __future__ import annotations

import math

import msgspec

from surveilnav.geometry import Matrix4, Pinhole, Pose, camera_pose

#: The paper's views of a ceiling camera (section III-B): so many azimuths at this pitch, and one straight down.
AZIMUTHS = 12
PITCH_RAD = math.radians(-30.0)


def views_around(position_m: tuple[float, float, float]) -> list[Matrix4]:
    """``T_world_camera`` of the paper's 13 views: 0-11 at azimuth 30 degrees times the number, 12 straight down."""
    around = [camera_pose(position_m, 2 * math.pi * k / AZIMUTHS, PITCH_RAD) for k in range(AZIMUTHS)]
    return [*around, camera_pose(position_m, 0.0, -math.pi / 2)]


class PlannedCamera(msgspec.Struct, frozen=True):
    """One camera of the plan.

    Attributes:
        position_m: (x, y, z) in the world.
        views: ``T_world_camera`` of its 13 views.
        half: indices of the six views that the paper's variant with half the views uses.
    """

    name: str
    floor: str
    position_m: tuple[float, float, float]
    views: list[Pose]
    half: tuple[int, ...] = ()


class CameraPlan(msgspec.Struct, frozen=True):
    """All cameras of a building.

    Attributes:
        scene_hash: hash of the scene, part of the keys of cached views.
        floors: ids of the building's floors.
        mounting_offset_m: height of each camera above its floor.
        intrinsics: of each camera.
    """

    building: str
    scene_hash: str
    floors: list[str]
    mounting_offset_m: float
    intrinsics: Pinhole
    cameras: list[PlannedCamera]

    def camera(self, name: str) -> PlannedCamera | None:
        return next((c for c in self.cameras if c.name == name), None)
