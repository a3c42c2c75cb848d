"""The objects of the joint map and their histories; the routes ``/objects``."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Request, Response

from surveilnav import contract
from surveilnav.bus import Received
from surveilnav.contract import ID_PATTERN
from surveilnav.messages import ObjectList, ObjectRecord
from surveilnav.rest import ROOT, Items, Object, ObjectEvent
from surveilnav.services.gateway.access_log import AccessLog
from surveilnav.services.gateway.answer_cache import AnswerCache
from surveilnav.services.gateway.bus_requests import absent, request_existing
from surveilnav.services.gateway.core.camera_views import crop
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import object_from_record
from surveilnav.services.gateway.core.selection import ObjectFilter
from surveilnav.services.gateway.responses import JPEG, Id, Limit, Offset
from surveilnav.services.gateway.state import BuildingState

#: Within this time, all clients get the same answer, to spare fusion while robots search.
_LIST_AGE_S = 1.0
_MAX_LISTS = 64
_Number = Annotated[int, Path(ge=0, le=2**31 - 1)]


class Objects:
    """The objects of the building, requested from fusion."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self._lists: AnswerCache[list[Received[ObjectList]]] = AnswerCache(_LIST_AGE_S, _MAX_LISTS)

    def clear(self) -> None:
        """Empties the cache, because objects have changed or a replay jumped to another moment."""
        self._lists.clear()

    def records(self, wanted: ObjectFilter, text: str = "") -> list[ObjectRecord]:
        """The wanted objects by floor, the last seen first.

        With a ``text``, the objects whose pictures fit it best come first. Without, answers are cached for a second, or until an
        object changes.
        """
        if text:
            rows = self._object_lists(wanted.floor, {"text": text})
        else:
            rows = self._lists.get(wanted.floor, lambda: self._object_lists(wanted.floor, None))
        return wanted.apply(r for row in rows for r in row.message.objects)

    def _object_lists(self, floor: str | None, parameters: dict[str, str] | None) -> list[Received[ObjectList]]:
        """Fusion's lists of objects, of one floor or of all."""
        if floor is None and not self._state.alive("fusion"):
            raise absent("fusion")
        if floor is None and parameters is None:
            return self._node.ask_all(contract.OBJECTS)
        names = [floor] if floor is not None else self._state.revisions.newest("floor")  # a text may be refused
        return [
            request_existing(self._node, "floor", name, "fusion", contract.OBJECTS, parameters=parameters, floor=name)
            for name in names
        ]

    def one(self, floor: str, id: int) -> Object:
        """One object with its whole history; 404 if there is none, or none any more."""
        what = f"object on floor {floor}"
        parameters = {"object": str(id)}
        row = request_existing(
            self._node, what, str(id), "fusion", contract.OBJECTS, parameters=parameters, floor=floor
        )
        found = next((r for r in row.message.objects if r.id == id), None)
        if found is None:
            raise Problem(502, "bad_answer", f"fusion was asked for object {id} of floor {floor}, and told of others")
        return object_from_record(found)

    def picture(self, floor: str, id: int, number: int) -> tuple[ObjectEvent, bytes]:
        """An event of an object's history, and a JPEG of what was detected: the part of the picture around the box.

        404 if the event has no detection, or its picture isn't kept any more.
        """
        history = self.one(floor, id).history
        if number >= len(history):
            raise Problem(404, "not_found", f"object {id} has a history of {len(history)} events, from 0")
        event = history[number]
        if event.box_px is None:
            raise Problem(404, "no_picture", f"event {number} of object {id} ({event.what}) saw nothing")
        parameters = {"source": event.source, "view": str(event.view), "seq": str(event.seq)}
        row = request_existing(
            self._node,
            "picture of object",
            str(id),
            "fusion",
            contract.VIEW_PICTURE,
            parameters=parameters,
            floor=floor,
        )
        try:
            return event, crop(row.payload, event.box_px)
        except ValueError as error:
            raise Problem(502, "bad_picture", f"fusion sent a picture that can't be shown: {error}") from error


def router(objects: Objects, access_log: AccessLog) -> APIRouter:
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/objects", name="objects")
    def list_objects(
        floor: Annotated[str | None, Query(pattern=ID_PATTERN)] = None,
        label: Annotated[str | None, Query(max_length=200)] = None,
        status: Literal["candidate", "confirmed", "rejected"] | None = None,
        min_confidence: Annotated[float, Query(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0,
        text: Annotated[str, Query(max_length=200)] = "",
        limit: Limit = 100,
        offset: Offset = 0,
    ) -> Items[Object]:
        """Objects with the last event of their history, by floor, the last seen first. The answer may be a second old. With
        ``text``, the objects that look most like it come first, with their ``relevance``. A perception worker with a closed
        vocabulary refuses words that it doesn't know."""
        wanted = ObjectFilter(floor, label, status, min_confidence)
        records = objects.records(wanted, text.strip())
        page = [object_from_record(r) for r in records[offset : offset + limit]]
        return Items(items=page, total=len(records))

    @router.get("/floors/{id}/objects/{object}")
    def one_object(id: Id, object: _Number) -> Object:
        """One object with its whole history: which source detected what and when, and how that changed the object."""
        return objects.one(id, object)

    @router.get("/floors/{id}/objects/{object}/history/{number}.jpg", response_class=Response, responses=JPEG)
    def picture(request: Request, id: Id, object: _Number, number: _Number) -> Response:
        """What was detected at an event of the history (``number``: its index, from 0): a small picture around the box. 404 if
        the event has no detection, or its picture isn't kept any more: fusion only keeps those of its newest views."""
        event, jpeg = objects.picture(id, object, number)
        kind, _, camera = event.source.partition("/")
        if kind == "camera":
            access_log.record(request, camera, event.view, "history")
        # never cached: pictures can be forgotten, and merging objects changes their events' indices
        return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    return router
