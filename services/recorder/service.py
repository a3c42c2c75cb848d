"""The recorder: every mission as one file, from its start to its end."""

from __future__ import annotations

from typing import Any

from surveilnav import contract
from surveilnav.bus import Node, Received, clock_ns
from surveilnav.contract import Stream
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.facts import mission_facts, outcome_facts
from surveilnav.services.recorder.core.names import recording_id
from surveilnav.services.recorder.folder import RecordingFolder
from surveilnav.services.recorder.map_recorder import MapRecorder
from surveilnav.services.recorder.prompt_embeddings import PromptEmbeddingRecorder
from surveilnav.services.recorder.queries import RecordingQueries
from surveilnav.services.recorder.recorded_mission import RecordedMission, is_under_way
from surveilnav.services.recorder.status import RecorderStatusPublisher
from surveilnav.services.recorder.view_recorder import ViewRecorders
from surveilnav.services.recorder.writer import RecordingWriter

#: Published streams that are recorded. Frames aren't among them: to subscribe to a camera's frames is to have it send them.
_STREAMS = (
    contract.CAMERA_INFO,
    contract.CAMERA_SUMMARY,
    contract.ROBOT_STATUS,
    contract.PERCEPTION_LOAD,
    contract.MAP_REVISION,
    contract.MISSION_STATUS,
    contract.MISSION_PLAN,
    contract.TRAFFIC,
    contract.SERVICES,
)


class RecorderService:
    """Follows missions, and records what is published about them and the views that go into the maps.

    Attributes:
        status: what the recorder tells of itself.
    """

    def __init__(self, node: Node, settings: RecorderSettings, keep_pictures_s: float | None = None) -> None:
        self._node, self._settings = node, settings
        self._folder = RecordingFolder(settings.folder)
        self._writer = RecordingWriter(node, settings, self._folder, keep_pictures_s)
        self._views = ViewRecorders(node, self._writer)
        self._embeddings = PromptEmbeddingRecorder(node, self._writer)
        self._maps = MapRecorder(node, settings, self._writer)
        self._recorded: dict[str, RecordedMission] = {}  # by mission
        self.status = RecorderStatusPublisher(node, settings.id, self._writer, self._views)
        RecordingQueries(node, settings, self._folder)
        self._tables = {stream: self._table(stream) for stream in _STREAMS}
        self.status.start()

    def step(self) -> bool:
        """One turn of the loop; returns whether there is more to do."""
        for row in self._tables[contract.MISSION_STATUS].rows():
            self._on_mission(row)
        written = [m for m in self._recorded.values() if m.id not in self._writer.failed]
        more = self._views.catch_up(written)
        self._embeddings.record_missing(written)
        revisions = [row.message for row in self._tables[contract.MAP_REVISION].rows()]
        over = [m for m in self._recorded.values() if m.is_over(clock_ns())]
        self._maps.record([m for m in written if m not in over], revisions)
        for mission in over:
            maps = {}
            if mission.id not in self._writer.failed:
                self._maps.record([mission], revisions, last=True)
                maps = self._views.finish(mission)
            del self._recorded[mission.status.mission]
            self._maps.forget(mission)
            self._writer.end(mission.id, {**outcome_facts(mission.status), **maps})
        return more

    def close(self) -> None:
        """Closes the files. Recordings whose missions go on are marked as interrupted."""
        self._writer.close()

    def _table(self, stream: Stream) -> Any:
        return self._node.table(stream, on_message=lambda row: self._on_message(stream, row))

    def _on_message(self, stream: Stream, row: Received[Any]) -> None:
        """Records a message, on the bus's thread. One of a mission goes only into that mission's file."""
        mission = row.ids.get("mission")
        ids = [m.id for name, m in list(self._recorded.items()) if mission in (None, name)]
        if ids:
            self._writer.record(ids, _bus_message(stream, row))

    def _on_mission(self, row: Received[Any]) -> None:
        mission, status = row.ids["mission"], row.message
        if mission in self._recorded:
            self._recorded[mission].update(status, clock_ns())
        elif is_under_way(status):
            begun = RecordedMission(recording_id(clock_ns(), mission), status)
            self._writer.begin(begun.id, mission_facts(mission, status, self._node.building))
            self._recorded[mission] = begun
            for stream, table in self._tables.items():  # the newest messages from before
                for before in [r for r in table.rows() if r.ids.get("mission") in (None, mission)]:
                    self._writer.record([begun.id], _bus_message(stream, before))


def _bus_message(stream: Stream, row: Received[Any]) -> BusMessage:
    return BusMessage(stream, row.key, row.message, row.payload, clock_ns())
