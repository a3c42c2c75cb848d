"""What a mission's target means to perception: with it a replay has a value layer without any model."""

from __future__ import annotations

import time
from collections.abc import Iterable

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import PERCEPTION_TEXT
from surveilnav.errors import BusError
from surveilnav.messages import InferRequest
from surveilnav.perception.prompts import value_prompt
from surveilnav.services.recorder.core.drawer import Heard
from surveilnav.services.recorder.missions import Recorded
from surveilnav.services.recorder.scribe import Scribe

_PATIENCE_S, _AGAIN_S = 2.0, 3.0


class Meanings:
    """Has a worker's embedding of each mission's prompt recorded, as soon as one tells. Used by the loop alone."""

    def __init__(self, node: Node, scribe: Scribe) -> None:
        self._node, self._scribe, self._again_s = node, scribe, 0.0
        node.alive("perception")  # the first call starts watching

    def follow(self, recorded: Iterable[Recorded]) -> None:
        """Asks for those that are missing, now and then."""
        lacking = [one for one in recorded if not one.has_meaning]
        if not lacking or time.monotonic() < self._again_s:
            return
        for one in lacking:
            if found := self._meaning_of(value_prompt(one.status.target)):
                one.has_meaning = self._scribe.hear([one.id], found)
        self._again_s = time.monotonic() + _AGAIN_S

    def _meaning_of(self, prompt: str) -> Heard | None:
        for worker in sorted(self._node.alive("perception")):
            request = InferRequest(stamp_ns=clock_ns(), texts=[prompt])
            try:
                told = self._node.ask(PERCEPTION_TEXT, request, worker=worker, timeout_s=_PATIENCE_S)
            except BusError:
                continue
            return Heard(PERCEPTION_TEXT, told.key, told.message, b"", clock_ns())
        return None
