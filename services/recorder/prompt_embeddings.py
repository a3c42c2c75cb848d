"""Records the embedding of each mission's prompt, so that a replay has a value layer without any model."""

from __future__ import annotations

import time
from collections.abc import Iterable

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import PERCEPTION_TEXT
from surveilnav.errors import BusError
from surveilnav.messages import InferRequest
from surveilnav.perception.prompts import value_prompt
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.recorded_mission import RecordedMission
from surveilnav.services.recorder.writer import RecordingWriter

_TIMEOUT_S, _RETRY_S = 2.0, 3.0


class PromptEmbeddingRecorder:
    """Asks perception workers for the embeddings, and records the first answer for each mission. For one thread."""

    def __init__(self, node: Node, writer: RecordingWriter) -> None:
        self._node, self._writer, self._retry_at_s = node, writer, 0.0
        node.alive("perception")  # the first call starts watching

    def record_missing(self, missions: Iterable[RecordedMission]) -> None:
        """Records the embeddings that are missing; asks for them at most every few seconds."""
        missing = [m for m in missions if not m.has_prompt_embedding]
        if not missing or time.monotonic() < self._retry_at_s:
            return
        for mission in missing:
            if answer := self._ask_workers(value_prompt(mission.status.target)):
                mission.has_prompt_embedding = self._writer.record([mission.id], answer)
        self._retry_at_s = time.monotonic() + _RETRY_S

    def _ask_workers(self, prompt: str) -> BusMessage | None:
        for worker in sorted(self._node.alive("perception")):
            request = InferRequest(stamp_ns=clock_ns(), texts=[prompt])
            try:
                answer = self._node.ask(PERCEPTION_TEXT, request, worker=worker, timeout_s=_TIMEOUT_S)
            except BusError:
                continue
            return BusMessage(PERCEPTION_TEXT, answer.key, answer.message, b"", clock_ns())
        return None
