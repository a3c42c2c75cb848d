"""Which waiting camera view is perceived next, and in which order a camera with a budget sends its views.

A ranking by utility (``core.views.order``), renewed while the maps grow.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from surveilnav.messages import CameraInfo, FrameHeader
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core.views.order import ViewFootprint, highest_first
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from surveilnav.services.fusion.perceived import ViewKey

_MAX_AGE_S = 0.5  # after which a ranking is made anew


class ViewRanking:
    """Ranks waiting views by what they may still show near the robots. ``pop_best`` is for one thread."""

    def __init__(self, maps: BuildingMaps, positions: RobotPositions) -> None:
        self._maps, self._positions = maps, positions
        self._ranked: list[ViewKey] = []  # the best one last
        self._ranked_s = 0.0

    def pop_best(self, waiting: Mapping[ViewKey, FrameHeader]) -> ViewKey:
        """The best of one or more waiting views. By the next call, the caller must have removed it from the waiting ones."""
        if time.monotonic() - self._ranked_s >= _MAX_AGE_S:
            self._ranked = []
        while self._ranked:
            if (best := self._ranked.pop()) in waiting:
                return best
        self._ranked = self._rank(waiting)
        self._ranked_s = time.monotonic()
        return self._ranked.pop()

    def order(self, info: CameraInfo) -> list[int]:
        """The views of a camera, the one that may still show most near robots first."""
        range_m = self._maps.joint.config.map.explored_range_camera_m
        floor_z_m = info.position_m[2] - info.mounting_offset_m
        footprints = [
            ViewFootprint.from_view(view.T_world_camera.matrix(), info.intrinsics, floor_z_m, range_m)
            for view in info.views
        ]
        return [info.views[k].view for k in self._best_first(footprints)]

    def _best_first(self, footprints: Sequence[ViewFootprint]) -> Sequence[int]:
        robots_m = [(position.x_m, position.y_m, position.z_m) for _, position in self._positions.items()]
        with self._maps.lock:
            return highest_first(self._maps.joint.view_utilities(footprints, robots_m))

    def _rank(self, waiting: Mapping[ViewKey, FrameHeader]) -> list[ViewKey]:
        range_m = self._maps.joint.config.map.explored_range_camera_m
        order = self._best_first([_footprint(header, range_m) for header in waiting.values()])
        keys = list(waiting)
        return [keys[k] for k in reversed(order)]


def _footprint(header: FrameHeader, range_m: float) -> ViewFootprint:
    T_world_camera = header.T_world_camera.matrix()
    floor_z_m = float(T_world_camera[2, 3]) - header.mounting_offset_m
    return ViewFootprint.from_view(T_world_camera, header.camera, floor_z_m, range_m)
