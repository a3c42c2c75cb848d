"""The objects of the joint map, with their histories."""

from __future__ import annotations

from surveilnav import contract
from surveilnav.bus import Received
from surveilnav.messages import ObjectList, ObjectRecord
from surveilnav.services.gateway.asking import absent, ask_known
from surveilnav.services.gateway.core.crops import crop
from surveilnav.services.gateway.core.object_filter import ObjectFilter
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import Object
from surveilnav.services.gateway.core.resources.object import ObjectEvent
from surveilnav.services.gateway.single_flight import SingleFlight
from surveilnav.services.gateway.state import BuildingState

#: So long one answer of fusion serves all who list objects: it has much else to do while a robot searches.
_LIST_S = 1.0


class Objects:
    """What fusion tells of the building's objects."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self._lists: SingleFlight[list[Received[ObjectList]]] = SingleFlight(_LIST_S, most=64)

    def clear(self) -> None:
        """Has fusion asked anew: its objects changed, or a replay was taken to another moment."""
        self._lists.clear()

    def records(self, wanted: ObjectFilter, text: str = "") -> list[ObjectRecord]:
        """The objects wanted, by floor, last seen first. With a text: those first that fit it best, by what their
        pictures looked like. Without, all who ask within a second get one answer, unless an object changed meanwhile."""
        if text:
            rows = self._object_lists(wanted.floor, {"text": text})
        else:
            rows = self._lists.get(wanted.floor, lambda: self._object_lists(wanted.floor, None))
        return wanted.chosen(r for row in rows for r in row.message.objects)

    def _object_lists(self, floor: str | None, parameters: dict[str, str] | None) -> list[Received[ObjectList]]:
        """What fusion holds of one floor, or of all."""
        if floor is None and not self._state.alive("fusion"):
            raise absent("fusion")
        if floor is None and parameters is None:
            return self._node.ask_all(contract.OBJECTS)
        names = [floor] if floor is not None else self._state.revisions.newest("floor")  # a text may be refused
        return [
            ask_known(self._node, "floor", name, "fusion", contract.OBJECTS, parameters=parameters, floor=name)
            for name in names
        ]

    def one(self, floor: str, id: int) -> Object:
        """One object with all that ever happened to it; 404 if it isn't there (any more)."""
        what = f"object on floor {floor}"
        asked = {"object": str(id)}
        row = ask_known(self._node, what, str(id), "fusion", contract.OBJECTS, parameters=asked, floor=floor)
        found = next((r for r in row.message.objects if r.id == id), None)
        if found is None:
            raise Problem(502, "bad_answer", f"fusion was asked for object {id} of floor {floor}, and told of others")
        return Object.from_record(found)

    def picture(self, floor: str, id: int, number: int) -> tuple[ObjectEvent, bytes]:
        """An event of an object's history, and what it saw: a JPEG around the box; 404 if it saw nothing, or nobody keeps
        it."""
        history = self.one(floor, id).history
        if number >= len(history):
            raise Problem(404, "not_found", f"object {id} has a history of {len(history)} events, from 0")
        event = history[number]
        if event.box_px is None:
            raise Problem(404, "no_picture", f"event {number} of object {id} ({event.what}) saw nothing")
        asked = {"source": event.source, "view": str(event.view), "seq": str(event.seq)}
        row = ask_known(
            self._node, "picture of object", str(id), "fusion", contract.VIEW_PICTURE, parameters=asked, floor=floor
        )
        try:
            return event, crop(row.payload, event.box_px)
        except ValueError as error:
            raise Problem(502, "bad_picture", f"fusion sent a picture that can't be shown: {error}") from error
