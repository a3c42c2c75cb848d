"""Has fusion's maps and objects drawn into the recordings, now and then."""

from __future__ import annotations

import time
from collections.abc import Sequence

from surveilnav.bus import Node, Received, clock_ns
from surveilnav.contract import MAP_LAYER, OBJECTS, Stream
from surveilnav.errors import BusError
from surveilnav.messages import Revision
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.core.drawer import Heard
from surveilnav.services.recorder.fusion import Fusion
from surveilnav.services.recorder.missions import Recorded
from surveilnav.services.recorder.scribe import Scribe

_GRIDS = ("occupancy", "explored", "frontier")


class Drawings:
    """Used by the loop alone."""

    def __init__(self, node: Node, settings: RecorderSettings, fusion: Fusion, scribe: Scribe) -> None:
        self._node, self._settings, self._fusion, self._scribe = node, settings, fusion, scribe
        self._drawn: dict[tuple[str, str], tuple[int, float]] = {}  # by recording and what is drawn: revision, when

    def draw(self, recorded: Sequence[Recorded], revisions: Sequence[Revision], *, last: bool = False) -> None:
        """Draws what changed and is due. ``last``: all that changed, since the mission is over."""
        for one in recorded:
            for revision in revisions:
                self._draw(one, revision, last)

    def forget(self, one: Recorded) -> None:
        """Its file is closed."""
        self._drawn = {key: at for key, at in self._drawn.items() if key[0] != one.id}

    def _draw(self, one: Recorded, revision: Revision, last: bool) -> None:
        floor, target = revision.floor, one.status.target
        due = {"grids": self._settings.layers_s, "cloud": self._settings.cloud_s}
        for what, every_s in due.items():
            if not self._is_due(one, f"{floor} {what}", revision.revision, 0.0 if last else every_s):
                continue
            layers = ("cloud",) if what == "cloud" else (*_GRIDS, "value") if floor == one.status.floor else _GRIDS
            try:
                for layer in layers:
                    self._hear(one, MAP_LAYER, self._fusion.layer(floor, layer, target))
                if what == "grids":
                    self._hear(one, OBJECTS, self._fusion.objects(floor))
            except BusError as error:
                self._node.warn_seldom("the maps can't be drawn", floor=floor, error=str(error))

    def _is_due(self, one: Recorded, what: str, revision: int, every_s: float) -> bool:
        known, at_s = self._drawn.get((one.id, what), (-1, -1e9))
        now_s = time.monotonic()
        if revision == known or now_s - at_s < every_s or not self._scribe.has_room:
            return False
        self._drawn[one.id, what] = revision, now_s
        return True

    def _hear(self, one: Recorded, stream: Stream, received: Received) -> None:
        self._scribe.hear([one.id], Heard(stream, received.key, received.message, received.payload, clock_ns()))
