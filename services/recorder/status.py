"""What the recorder tells of itself."""

from __future__ import annotations

import threading
from contextlib import suppress

from surveilnav.bus import Answer, Node, clock_ns
from surveilnav.contract import RECORDER_STATUS
from surveilnav.errors import BusError
from surveilnav.messages import RecorderStatus
from surveilnav.services.recorder.view_recorder import ViewRecorders
from surveilnav.services.recorder.writer import RecordingWriter

_PERIOD_S = 1.0


class RecorderStatusPublisher:
    """Answers questions for the recorder's status, and publishes it every second, also while recording waits for fusion."""

    def __init__(self, node: Node, recorder: str, writer: RecordingWriter, views: ViewRecorders) -> None:
        self._node, self._recorder, self._writer, self._views = node, recorder, writer, views
        self._publisher = node.publisher(RECORDER_STATUS, recorder=recorder)
        node.serve(RECORDER_STATUS, lambda _: Answer(self.status()), recorder=recorder)

    def start(self) -> None:
        """Begins to publish."""
        threading.Thread(target=self._publish, name="status", daemon=True).start()

    def status(self) -> RecorderStatus:
        """The status, without touching the disk, which may hang."""
        writer = self._writer
        return RecorderStatus(
            stamp_ns=clock_ns(),
            recorder=self._recorder,
            recording=writer.open,
            dropped=writer.dropped,
            problem=writer.problem or self._views.problem,
            n_bytes=writer.n_bytes,
            free_bytes=writer.free_bytes,
        )

    def _publish(self) -> None:
        while not self._node.stopping.wait(_PERIOD_S):
            status = self.status()
            self._node.report_problem("recordings", status.problem)
            with suppress(BusError):  # the next one follows soon
                self._publisher.put(status)
