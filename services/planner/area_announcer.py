"""Tells others which areas the planner knows: keepout zones, doors and lifts, and whether they are open."""

from __future__ import annotations

import time

from surveilnav.bus import Answer, Node, Publisher, Refused, Request, clock_ns
from surveilnav.contract import FLOOR_AREAS
from surveilnav.messages import Area, FloorAreas
from surveilnav.services.planner.areas import BuildingAreas

_LOOK_S = 0.5


class AreaAnnouncer:
    """Publishes the areas of a floor when they have changed, and answers who asks for them."""

    def __init__(self, node: Node, areas: BuildingAreas) -> None:
        self._node, self._areas = node, areas
        self._publishers: dict[str, Publisher] = {}
        self._published: dict[str, list[Area]] = {}
        self._looked_s = 0.0
        node.serve(FLOOR_AREAS, self._on_query)

    def publish(self) -> None:
        """Publishes what has changed. A floor that the building file doesn't have any more has no areas."""
        now_s = time.monotonic()
        if now_s - self._looked_s < _LOOK_S:
            return
        self._looked_s = now_s
        for floor in self._published.keys() | set(self._areas.floors()):
            areas = self._areas.as_messages(floor)
            if areas == self._published.get(floor):
                continue
            if floor not in self._publishers:
                self._publishers[floor] = self._node.publisher(FLOOR_AREAS, floor=floor)
            self._publishers[floor].put(_message(floor, areas))
            self._published[floor] = areas

    def _on_query(self, request: Request) -> list[Answer]:
        wanted, known = request.ids.get("floor", "*"), self._areas.floors()
        if "*" not in wanted and wanted not in known:
            raise Refused("unknown_floor", f"the building file has no areas of floor {wanted!r}")
        floors = known if "*" in wanted else [wanted]
        return [Answer(_message(floor, self._areas.as_messages(floor)), ids={"floor": floor}) for floor in floors]


def _message(floor: str, areas: list[Area]) -> FloorAreas:
    return FloorAreas(stamp_ns=clock_ns(), floor=floor, areas=areas)
