"""The channel that only ``oracle`` and ``simulated`` have: instance ids of views, put by simulator nodes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping

import numpy as np

from surveilnav.bus import Node, Received
from surveilnav.contract import TRUTH
from surveilnav.errors import WireError
from surveilnav.messages import Truth
from surveilnav.sensing.packing import MAX_PIXELS, unpack_array
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
        return unpack_truth(truth, packed)


def unpack_truth(truth: Truth, packed: bytes) -> TrueInstances:
    """The instance ids in a message and its payload. Raises WireError."""
    if truth.width_px < 1 or truth.height_px < 1 or truth.width_px * truth.height_px > MAX_PIXELS:
        raise WireError(f"instance ids of {truth.width_px}x{truth.height_px} pixels make no sense")
    labels: Mapping[int, str] = truth.labels
    if any(not 1 <= id_ <= 65535 or len(label) > 100 for id_, label in labels.items()):
        raise WireError("labels of instance ids go from 1 to 65535, with at most 100 characters each")
    pose = truth.T_world_camera.matrix() if truth.T_world_camera is not None else None
    return TrueInstances(unpack_array(packed, np.uint16, (truth.height_px, truth.width_px)), dict(labels), pose)
