"""Which cameras a building has and where they look: what a camera node leases a place from."""

from __future__ import annotations

import msgspec

from surveilnav.geometry import Pinhole, Pose


class PlannedCamera(msgspec.Struct, frozen=True):
    """One camera of the plan: poses of its 13 views, ``T_world_camera``; ``half``: the six of the paper's half views."""

    name: str
    floor: str
    position_m: tuple[float, float, float]
    views: list[Pose]
    half: tuple[int, ...] = ()


class CameraPlan(msgspec.Struct, frozen=True):
    """All cameras of a building, its floors, and the hash of the scene that their cached views show."""

    building: str
    scene_hash: str
    floors: list[str]
    mounting_offset_m: float
    intrinsics: Pinhole
    cameras: list[PlannedCamera]

    def camera(self, name: str) -> PlannedCamera | None:
        """The camera of that name; None: there is none."""
        return next((c for c in self.cameras if c.name == name), None)
