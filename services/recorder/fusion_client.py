"""Queries to a fusion service: its log of views, and its maps."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.bus import Node, Received
from surveilnav.contract import MAP_SNAPSHOT, VIEW_LOG
from surveilnav.errors import BusError
from surveilnav.messages import LoggedView, MapSnapshot

_MAX_SNAPSHOT_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class FusionClient:
    """Queries to one fusion service. Every method raises BusError if it doesn't answer or refuses."""

    node: Node
    fusion: str

    def next_view(self, after: int) -> Received[LoggedView]:
        """The first view in fusion's log after number ``after``; one with number 0 if there is none yet."""
        return self.node.ask(VIEW_LOG, parameters={"after": str(after), "fusion": self.fusion})

    def digest(self) -> MapSnapshot:
        """Number, revision and digest of the maps now, without the maps."""
        header: MapSnapshot = self._snapshot(only="digest").message
        return header

    def snapshot(self) -> tuple[MapSnapshot, bytes]:
        """A snapshot of the maps now, fetched in parts."""
        part = self._snapshot()
        first: MapSnapshot = part.message
        if first.n_bytes > _MAX_SNAPSHOT_BYTES:
            raise BusError(f"maps of {first.n_bytes >> 20} MB are too large for a recording")
        data = [part.payload]
        while (received := sum(map(len, data))) < first.n_bytes:
            part = self._snapshot(number=str(first.number), offset=str(received))
            if not part.payload or part.message.number != first.number:
                raise BusError("fusion's snapshot of the maps changed while it was fetched")
            data.append(part.payload)
        return first, b"".join(data)

    def _snapshot(self, **parameters: str) -> Received[MapSnapshot]:
        return self.node.ask(MAP_SNAPSHOT, parameters={**parameters, "fusion": self.fusion})
