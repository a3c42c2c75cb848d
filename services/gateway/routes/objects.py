"""``/objects``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request, Response

from surveilnav.contract import ID_PATTERN
from surveilnav.services.gateway.core.object_filter import ObjectFilter
from surveilnav.services.gateway.core.resources import ROOT, Items, Object
from surveilnav.services.gateway.looks import Looks
from surveilnav.services.gateway.objects import Objects
from surveilnav.services.gateway.routes.paging import Id, Limit, Offset

_Number = Annotated[int, Path(ge=0, le=2**31 - 1)]
_JPEG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/jpeg": {}}, "description": "the picture"}}


def router(found: Objects, looks: Looks) -> APIRouter:
    """Objects, and one with all that ever happened to it."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/objects")
    def objects(
        floor: Annotated[str | None, Query(pattern=ID_PATTERN)] = None,
        label: Annotated[str | None, Query(max_length=200)] = None,
        status: Literal["candidate", "confirmed", "rejected"] | None = None,
        min_confidence: Annotated[float, Query(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0,
        text: Annotated[str, Query(max_length=200)] = "",
        limit: Limit = 100,
        offset: Offset = 0,
    ) -> Items[Object]:
        """Objects with what last happened to them, by floor, last seen first. All who ask within a second may get one answer.
        ``text``: words that a perception worker understands (one with a closed set refuses others); those that look most
        like them first, with their ``relevance``."""
        wanted = ObjectFilter(floor, label, status, min_confidence)
        records = found.records(wanted, text.strip())
        shown = [Object.from_record(r) for r in records[offset : offset + limit]]
        return Items(items=shown, total=len(records))

    @router.get("/floors/{id}/objects/{object}")
    def one_object(id: Id, object: _Number) -> Object:
        """One object with its whole history: who said what of it when, and what came of it."""
        return found.one(id, object)

    @router.get("/floors/{id}/objects/{object}/history/{number}.jpg", response_class=Response, responses=_JPEG)
    def picture(
        request: Request,
        id: Id,
        object: Annotated[int, Path(ge=0, le=2**31 - 1)],
        number: Annotated[int, Path(ge=0, le=2**31 - 1)],
    ) -> Response:
        """What an event of the history (by its place, from 0) saw: a small picture around the box. 404 where nothing was
        seen, and where the picture isn't kept any more: fusion keeps those of its newest views."""
        headers = {
            "Cache-Control": "no-store"
        }  # pictures can be forgotten, and objects that become one are numbered anew
        event, picture = found.picture(id, object, number)
        kind, _, source = event.source.partition("/")
        if kind == "camera":
            looks.note(request, source, event.view, "history")
        return Response(picture, media_type="image/jpeg", headers=headers)

    return router
