"""Queries to fusion: its log of views, its maps, and what is shown of them. Cameras aren't involved."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.bus import Node, Received
from surveilnav.contract import MAP_LAYER, MAP_SNAPSHOT, OBJECTS, VIEW_LOG
from surveilnav.errors import BusError
from surveilnav.messages import LayerHeader, LoggedView, MapSnapshot, ObjectList

_MAX_SNAPSHOT_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class FusionClient:
    """Queries to fusion. Every method raises BusError if fusion doesn't answer or refuses."""

    node: Node

    def next_view(self, after: int) -> Received[LoggedView]:
        """The first view in fusion's log after number ``after``; one with number 0 if there is none yet."""
        return self.node.ask(VIEW_LOG, parameters={"after": str(after)})

    def digest(self) -> MapSnapshot:
        """Number, revision and digest of the maps now, without the maps."""
        header: MapSnapshot = self.node.ask(MAP_SNAPSHOT, parameters={"only": "digest"}).message
        return header

    def snapshot(self) -> tuple[MapSnapshot, bytes]:
        """A snapshot of the maps now, fetched in parts."""
        part = self.node.ask(MAP_SNAPSHOT)
        first: MapSnapshot = part.message
        if first.n_bytes > _MAX_SNAPSHOT_BYTES:
            raise BusError(f"maps of {first.n_bytes >> 20} MB are too large for a recording")
        data = [part.payload]
        while (received := sum(map(len, data))) < first.n_bytes:
            part = self.node.ask(MAP_SNAPSHOT, parameters={"number": str(first.number), "offset": str(received)})
            if not part.payload or part.message.number != first.number:
                raise BusError("fusion's snapshot of the maps changed while it was fetched")
            data.append(part.payload)
        return first, b"".join(data)

    def layer(self, floor: str, layer: str, target: str) -> Received[LayerHeader]:
        """A layer of a floor; ``target`` matters to the value layer."""
        parameters = {"target": target} if layer == "value" else None
        return self.node.ask(MAP_LAYER, floor=floor, layer=layer, parameters=parameters)

    def objects(self, floor: str) -> Received[ObjectList]:
        """The objects of a floor, without their points."""
        return self.node.ask(OBJECTS, floor=floor, parameters={"detail": "brief"})
