"""``/events``: what happens, as it happens."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Response

from surveilnav.services.gateway.core.resources import ROOT
from surveilnav.services.gateway.event_stream import EventStream
from surveilnav.services.gateway.events import Events

_EXAMPLE = 'id: 3f2a90bd-17\nevent: mission\ndata: {"id":"m-1","what":"active","time":"2026-01-31T10:00:00Z","target":"tv"}\n\n'
_STREAM: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Server-Sent Events; the data of each is an Event as JSON",
        "content": {"text/event-stream": {"schema": {"type": "string"}, "example": _EXAMPLE}},
    }
}


def router(events: Events) -> APIRouter:
    """The stream of events."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/events", response_class=Response, responses=_STREAM)
    def stream(last_event_id: Annotated[str | None, Header(max_length=200)] = None) -> Response:
        """What changes, as Server-Sent Events: `mission`, `object`, `camera`, `robot`, `service`. Send back the id of
        the last event as `Last-Event-ID` (browsers do) and none is missed. `reset` says that some can't be had any more,
        or that you come for the first time: read the state anew."""
        return EventStream(events, last_event_id)

    return router
