"""Which waiting camera view is looked at next: the ranking of ``core.view_order``, made anew while the maps grow."""

from __future__ import annotations

import time
from collections.abc import Mapping

from surveilnav.messages import FrameHeader
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.core.views.order import ViewFootprint, highest_first
from surveilnav.services.fusion.map_log.log import DurableMap
from surveilnav.services.fusion.records import ViewKey
from surveilnav.services.fusion.robot_places import RobotPlaces

_RANKED_AGAIN_S = 0.5


class ViewChoice:
    """Ranks what waits by what it may still show near the robots. Not for several threads at a time."""

    def __init__(self, maps: DurableMap, places: RobotPlaces, config: FusionConfig) -> None:
        self._maps, self._places, self._range_m = maps, places, config.map.explored_range_camera_m
        self._ranked: list[ViewKey] = []  # the best one last
        self._ranked_s = 0.0

    def next_of(self, waiting: Mapping[ViewKey, FrameHeader]) -> ViewKey:
        """The view to look at next, out of one or more."""
        if time.monotonic() - self._ranked_s >= _RANKED_AGAIN_S:
            self._ranked = []
        while self._ranked:
            if (best := self._ranked.pop()) in waiting:
                return best
        self._ranked = self._rank(waiting)
        self._ranked_s = time.monotonic()
        return self._ranked.pop()

    def _rank(self, waiting: Mapping[ViewKey, FrameHeader]) -> list[ViewKey]:
        wedges = [self._wedge(header) for header in waiting.values()]
        robots_m = [(place.x_m, place.y_m, place.z_m) for _, place in self._places.items()]
        with self._maps.lock:
            order = highest_first(self._maps.joint.view_utilities(wedges, robots_m))
        keys = list(waiting)
        return [keys[k] for k in reversed(order)]

    def _wedge(self, header: FrameHeader) -> ViewFootprint:
        T_world_camera = header.T_world_camera.matrix()
        floor_z_m = float(T_world_camera[2, 3]) - header.mounting_offset_m
        return ViewFootprint.from_view(T_world_camera, header.camera, floor_z_m, self._range_m)
