"""Questions to fusion: its log of views, its maps, and what is drawn of them. No camera hears of it."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.bus import Node, Received
from surveilnav.contract import MAP_LAYER, MAP_SNAPSHOT, OBJECTS, VIEW_LOG
from surveilnav.errors import BusError
from surveilnav.messages import LayerHeader, LoggedView, MapSnapshot, ObjectList

_MOST_SNAPSHOT_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class Fusion:
    """Every call raises BusError: fusion isn't there, or refuses."""

    node: Node

    def next_view(self, after: int) -> Received[LoggedView]:
        """The first view that the maps took after number ``after``."""
        return self.node.ask(VIEW_LOG, parameters={"after": str(after)})

    def digest(self) -> MapSnapshot:
        """What the maps come to now."""
        told: MapSnapshot = self.node.ask(MAP_SNAPSHOT, parameters={"only": "digest"}).message
        return told

    def snapshot(self) -> tuple[MapSnapshot, bytes]:
        """The maps as they are now, in one piece."""
        part = self.node.ask(MAP_SNAPSHOT)
        first: MapSnapshot = part.message
        if first.n_bytes > _MOST_SNAPSHOT_BYTES:
            raise BusError(f"maps of {first.n_bytes >> 20} MB are too large for a recording")
        data = [part.payload]
        while (got := sum(map(len, data))) < first.n_bytes:
            part = self.node.ask(MAP_SNAPSHOT, parameters={"number": str(first.number), "offset": str(got)})
            if not part.payload or part.message.number != first.number:
                raise BusError("fusion told of other maps meanwhile")
            data.append(part.payload)
        return first, b"".join(data)

    def layer(self, floor: str, layer: str, target: str) -> Received[LayerHeader]:
        """A layer of a floor, to be drawn."""
        parameters = {"target": target} if layer == "value" else None
        return self.node.ask(MAP_LAYER, floor=floor, layer=layer, parameters=parameters)

    def objects(self, floor: str) -> Received[ObjectList]:
        """The objects of a floor, to be drawn."""
        return self.node.ask(OBJECTS, floor=floor, parameters={"detail": "brief"})
