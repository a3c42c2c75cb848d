"""The recorder: every mission as one file, from its start to its end."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any

from surveilnav import contract
from surveilnav.bus import Answer, Node, Received, clock_ns
from surveilnav.contract import RECORDER_STATUS, Stream
from surveilnav.errors import BusError
from surveilnav.messages import RecorderStatus, Revision
from surveilnav.perception.prompts import value_prompt
from surveilnav.services.recorder.answers import Answers
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.core.drawer import Heard
from surveilnav.services.recorder.core.names import recording_id
from surveilnav.services.recorder.drawings import Drawings
from surveilnav.services.recorder.folder import Folder
from surveilnav.services.recorder.fusion import Fusion
from surveilnav.services.recorder.meaning import Meanings
from surveilnav.services.recorder.missions import Recorded, is_under_way
from surveilnav.services.recorder.scribe import Scribe
from surveilnav.services.recorder.views import Views

#: What is put, small, and replayed. No frames: a camera sends them to whoever listens, and would have one listener more.
_HEARD = (
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
_STATUS_S = 1.0


class RecorderService:
    """Follows missions, and has what is heard of them written."""

    def __init__(self, node: Node, settings: RecorderSettings, keep_pictures_s: float | None = None) -> None:
        self._node, self._settings = node, settings
        self._folder = Folder(settings.folder)
        self._scribe = Scribe(node, settings, self._folder, keep_pictures_s)
        fusion = Fusion(node)
        self._views = Views(node, fusion, self._scribe)
        self._meanings = Meanings(node, self._scribe)
        self._drawings = Drawings(node, settings, fusion, self._scribe)
        self._recorded: dict[str, Recorded] = {}  # by mission
        self._status = node.publisher(RECORDER_STATUS, recorder=settings.id)
        Answers(node, settings, self._folder)
        node.serve(RECORDER_STATUS, lambda _: Answer(self.status()), recorder=settings.id)
        self._tables = {stream: self._table(stream) for stream in _HEARD}
        threading.Thread(target=self._tell, name="status", daemon=True).start()

    def step(self) -> bool:
        """One turn of the loop; True if there is more to do."""
        for row in self._tables[contract.MISSION_STATUS].rows():
            self._on_mission(row)
        written = [one for one in self._recorded.values() if one.id not in self._scribe.failed]
        more = self._views.follow(written)
        self._meanings.follow(written)
        revisions = [row.message for row in self._tables[contract.MAP_REVISION].rows()]
        over = [one for one in self._recorded.values() if one.is_over(clock_ns())]
        self._drawings.draw([one for one in written if one not in over], revisions)
        for one in over:
            self._end(one, revisions)
        return more

    def _tell(self) -> None:
        """Says how it is until the node ends, also while the loop waits for fusion."""
        while not self._node.stopping.wait(_STATUS_S):
            with suppress(BusError):  # a later one will come
                self._status.put(self.status())

    def status(self) -> RecorderStatus:
        """How it is. It touches no disk, which may hang."""
        scribe = self._scribe
        return RecorderStatus(
            stamp_ns=clock_ns(),
            recorder=self._settings.id,
            recording=scribe.open,
            dropped=scribe.dropped,
            problem=scribe.full or self._views.problem,
            n_bytes=scribe.n_bytes,
            free_bytes=scribe.free_bytes,
        )

    def close(self) -> None:
        """Closes the files; who reads them finds that their missions weren't over."""
        self._scribe.close()

    def _table(self, stream: Stream) -> Any:
        return self._node.table(stream, on_message=lambda row: self._hear(stream, row))

    def _hear(self, stream: Stream, row: Received[Any]) -> None:
        """On the bus's thread: what belongs to one mission goes into its file alone."""
        mission = row.ids.get("mission")
        ids = [one.id for name, one in list(self._recorded.items()) if mission in (None, name)]
        if ids:
            self._scribe.hear(ids, Heard(stream, row.key, row.message, row.payload, clock_ns()))

    def _on_mission(self, row: Received[Any]) -> None:
        mission, status = row.ids["mission"], row.message
        if mission in self._recorded:
            self._recorded[mission].hear(status, clock_ns())
        elif is_under_way(status):
            self._begin(mission, Recorded(recording_id(clock_ns(), mission), status))

    def _begin(self, mission: str, one: Recorded) -> None:
        facts = {
            "mission": mission,
            "target": one.status.target,
            "robot": one.status.robot,
            "building": self._node.building,
            "started_ns": str(one.status.started_ns),
            "prompt": value_prompt(one.status.target),
        }
        self._scribe.begin(one.id, facts)
        self._recorded[mission] = one
        for stream, table in self._tables.items():  # what was put before
            for row in [r for r in table.rows() if r.ids.get("mission") in (None, mission)]:
                self._scribe.hear([one.id], Heard(stream, row.key, row.message, row.payload, clock_ns()))

    def _end(self, one: Recorded, revisions: list[Revision]) -> None:
        maps = {}
        if one.id not in self._scribe.failed:
            self._drawings.draw([one], revisions, last=True)
            maps = self._views.end(one)
        del self._recorded[one.status.mission]
        self._drawings.forget(one)
        self._scribe.end(one.id, {"state": one.status.state, "found": str(one.status.found).lower(), **maps})
