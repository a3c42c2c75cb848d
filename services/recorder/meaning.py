"""What a mission's target means to perception: with it a replay has a value layer without any model."""

from __future__ import annotations

from services.recorder.core.drawer import Heard
from surveilnav.bus import Node, clock_ns
from surveilnav.contract import PERCEPTION_TEXT
from surveilnav.errors import BusError
from surveilnav.messages import InferRequest

_PATIENCE_S = 2.0


def meaning_of(node: Node, prompt: str) -> Heard | None:
    """A worker's embedding of a prompt; None where nobody tells."""
    for worker in sorted(node.alive("perception")):
        request = InferRequest(stamp_ns=clock_ns(), texts=[prompt])
        try:
            told = node.ask(PERCEPTION_TEXT, request, worker=worker, timeout_s=_PATIENCE_S)
        except BusError:
            continue
        return Heard(PERCEPTION_TEXT, told.key, told.message, b"", clock_ns())
    return None
