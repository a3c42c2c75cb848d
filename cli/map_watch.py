"""The maps of a search as they grow, asked of fusion now and then on a thread beside the recorder."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

from surveilnav.bus import Node
from surveilnav.cli.report.record import MapMoment
from surveilnav.contract import MAP_LAYER
from surveilnav.errors import BusError, WireError
from surveilnav.sensing.layers import unpack_layer

_PAUSE_S = 1.0
_MOST_MOMENTS = 400


class MapWatch:
    """A context: while it lasts, ``moments`` grows by the robot's floor as it is mapped, once a second at most.

    It asks for two layers, one at a time, and for none that it has. ``mapped`` says which floor's map holds which of the
    robot's observations, or None. Long searches are kept with every second moment, then every fourth, and so on.
    """

    def __init__(self, node: Node, mapped: Callable[[], tuple[str, int] | None]) -> None:
        self.moments: list[MapMoment] = []
        self._node, self._mapped = node, mapped
        self._pause_s, self._ended = _PAUSE_S, threading.Event()
        self._thread = threading.Thread(target=self._run, name="map-watch", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        if error is None:
            self.look()  # the last word, after the stop

    def look(self) -> None:
        """Asks for the map if it holds what no moment has."""
        now = self._mapped()
        if now is None or (self.moments and (self.moments[-1].floor, self.moments[-1].seq) == now):
            return
        floor, seq = now
        try:
            answers = {
                layer: self._node.ask(MAP_LAYER, floor=floor, layer=layer) for layer in ("explored", "occupancy")
            }
            cells = {layer: unpack_layer(layer, a.message, a.payload) for layer, a in answers.items()}
        except (BusError, WireError):
            return  # fusion is busy or away: the film lacks a moment
        grids = {a.message.grid for a in answers.values()}
        if len(grids) == 1:
            packed = MapMoment.pack(cells["explored"], cells["occupancy"])
            self.moments.append(MapMoment(seq, floor, grids.pop(), packed))

    def _run(self) -> None:
        while not self._ended.wait(self._pause_s):
            self.look()
            if len(self.moments) >= _MOST_MOMENTS:
                del self.moments[1::2]
                self._pause_s *= 2
