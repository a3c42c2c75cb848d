"""Records fusion's layers and objects for Foxglove, at intervals."""

from __future__ import annotations

import time
from collections.abc import Sequence

from surveilnav.bus import Node, Received, clock_ns
from surveilnav.contract import MAP_LAYER, OBJECTS, Stream
from surveilnav.errors import BusError
from surveilnav.messages import LayerHeader, Revision
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.recorded_mission import RecordedMission
from surveilnav.services.recorder.writer import RecordingWriter

_GRIDS = ("occupancy", "explored", "frontier")


class MapRecorder:
    """Records layers and objects of every floor into the missions' files. For one thread."""

    def __init__(self, node: Node, settings: RecorderSettings, writer: RecordingWriter) -> None:
        self._node, self._settings, self._writer = node, settings, writer
        #: (recording, floor, what) -> the revision that was recorded last, and when [s, monotonic]
        self._recorded: dict[tuple[str, str, str], tuple[int, float]] = {}

    def record(self, missions: Sequence[RecordedMission], revisions: Sequence[Revision], *, last: bool = False) -> None:
        """Records what changed and is due. ``last``: everything that changed, because the mission is over."""
        for mission in missions:
            for revision in revisions:
                self._record_floor(mission, revision, last)

    def forget(self, mission: RecordedMission) -> None:
        """Forgets a mission whose file is closed."""
        self._recorded = {key: value for key, value in self._recorded.items() if key[0] != mission.id}

    def _record_floor(self, mission: RecordedMission, revision: Revision, last: bool) -> None:
        floor, target = revision.floor, mission.status.target
        intervals_s = {"grids": self._settings.layers_s, "cloud": self._settings.cloud_s}
        for what, interval_s in intervals_s.items():
            if not self._is_due(mission, floor, what, revision.revision, 0.0 if last else interval_s):
                continue
            self._recorded[mission.id, floor, what] = revision.revision, time.monotonic()
            grids = (*_GRIDS, "value") if floor == mission.status.floor else _GRIDS
            try:
                for layer in ("cloud",) if what == "cloud" else grids:
                    self._write(mission, MAP_LAYER, self._layer(floor, layer, target))
                if what == "grids":
                    objects = self._node.ask(OBJECTS, floor=floor, parameters={"detail": "brief"})
                    self._write(mission, OBJECTS, objects)
            except BusError as error:
                self._node.warn_seldom("the maps can't be drawn", floor=floor, error=str(error))

    def _layer(self, floor: str, layer: str, target: str) -> Received[LayerHeader]:
        """A layer of a floor; ``target`` matters to the value layer."""
        parameters = {"target": target} if layer == "value" else None
        return self._node.ask(MAP_LAYER, floor=floor, layer=layer, parameters=parameters)

    def _is_due(self, mission: RecordedMission, floor: str, what: str, revision: int, interval_s: float) -> bool:
        recorded, at_s = self._recorded.get((mission.id, floor, what), (-1, -1e9))
        return revision != recorded and time.monotonic() - at_s >= interval_s and self._writer.has_room

    def _write(self, mission: RecordedMission, stream: Stream, received: Received) -> None:
        message = BusMessage(stream, received.key, received.message, received.payload, clock_ns())
        self._writer.record([mission.id], message)
