"""The channel that only ``oracle`` and ``simulated`` have: instance ids of views, put by simulator nodes."""

from __future__ import annotations

import threading
from collections import OrderedDict

from services.perception.config import PerceptionSettings
from surveilnav.bus import Node, Received, Refused
from surveilnav.contract import TRUTH
from surveilnav.messages import Truth
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.sensing.views import TrueInstances

_Key = tuple[str, int, int]


class TruthChannel:
    """Keeps the newest views' instance ids, still packed, and hands them out by (source, view, seq)."""

    def __init__(self, node: Node, backend: str, settings: PerceptionSettings) -> None:
        """``backend``: the name of the one that is told."""
        self._backend, self._kept, self._wait_s = backend, settings.truth_kept, settings.truth_wait_s
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

    def wait_for(self, source: str, view: int, seq: int) -> TrueInstances:
        """The instance ids of a view.

        Raises:
            Refused: they don't come in time.
            WireError: they came, but don't decode.
        """
        key = (source, view, seq)
        with self._arrived:
            if not self._arrived.wait_for(lambda: key in self._packed, self._wait_s):
                raise Refused(
                    "no_truth",
                    f"no instance ids of {source} view {view} seq {seq} arrived: "
                    f"the backend {self._backend} runs only where simulator nodes put them",
                )
            truth, packed = self._packed[key]
        return truth_from_wire(truth, packed)
