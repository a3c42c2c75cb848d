"""The channel that only ``oracle`` and ``simulated`` have: instance ids of views, put by simulator nodes."""

from __future__ import annotations

import threading
from collections import OrderedDict

from surveilnav.bus import Node, Received
from surveilnav.contract import TRUTH
from surveilnav.messages import Truth
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.sensing.views import TrueInstances

_Key = tuple[str, int, int]


class TruthChannel:
    """Keeps the newest ``kept`` views' instance ids, still packed, and hands them out by (source, view, seq)."""

    def __init__(self, node: Node, kept: int) -> None:
        self._kept = kept
        self._packed: OrderedDict[_Key, tuple[Truth, bytes]] = OrderedDict()
        self._arrived = threading.Condition()
        self._subscription = node.subscribe(TRUTH, self._keep)

    def _keep(self, received: Received[Truth]) -> None:
        truth = received.message
        with self._arrived:
            self._packed[truth.source, truth.view, truth.seq] = (truth, received.payload)
            while len(self._packed) > self._kept:
                self._packed.popitem(last=False)
            self._arrived.notify_all()

    def wait_for(self, source: str, view: int, seq: int, timeout_s: float) -> TrueInstances | None:
        """The instance ids of a view, or None if they don't come in time.

        Raises:
            WireError: they came, but don't decode.
        """
        key = (source, view, seq)
        with self._arrived:
            if not self._arrived.wait_for(lambda: key in self._packed, timeout_s):
                return None
            truth, packed = self._packed[key]
        return truth_from_wire(truth, packed)
