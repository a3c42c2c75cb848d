"""Answers queries about the recordings: which there are, their bytes, and deleting one."""

from __future__ import annotations

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import RECORDING_DELETE, RECORDING_READ, RECORDINGS
from surveilnav.messages import Ack, RecordingList, RecordingPart
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.folder import RecordingFolder


class RecordingQueries:
    """Serves the queries. They are answered on the bus's threads."""

    def __init__(self, node: Node, settings: RecorderSettings, folder: RecordingFolder) -> None:
        self._node, self._id, self._folder = node, settings.id, folder
        node.serve(RECORDINGS, self._list, recorder=settings.id)
        node.serve(RECORDING_READ, self._read, recorder=settings.id)
        node.serve(RECORDING_DELETE, self._delete, recorder=settings.id)

    def _list(self, _: Request) -> Answer:
        """All recordings, newest first."""
        try:
            found = self._folder.recordings()
        except OSError as error:
            raise Refused("disk_down", f"the recordings can't be read: {error}") from error
        return Answer(RecordingList(stamp_ns=clock_ns(), recorder=self._id, recordings=found))

    def _read(self, request: Request) -> Answer:
        wanted: RecordingPart = request.message
        try:
            data, size = self._folder.read(wanted.id, wanted.offset, wanted.n_bytes)
        except OSError as error:
            raise Refused("disk_down", f"the recording can't be read: {error}") from error
        part = RecordingPart(
            stamp_ns=clock_ns(), id=wanted.id, offset=wanted.offset, n_bytes=len(data), total_bytes=size
        )
        return Answer(part, data)

    def _delete(self, request: Request) -> Answer:
        try:
            self._folder.delete(request.message.id)
        except OSError as error:
            raise Refused("disk_down", f"the recording can't be deleted: {error}") from error
        self._node.log.warning("deleted a recording, as asked", id=request.message.id)
        return Answer(Ack(stamp_ns=clock_ns(), message=f"{request.message.id} is deleted"))
