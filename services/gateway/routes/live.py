"""``/live`` and ``/tiles``: how things are, as it changes."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Response
from starlette.requests import HTTPConnection
from starlette.types import Message, Receive, Scope, Send

from surveilnav.contract import ID
from surveilnav.services.gateway import tiles as shown
from surveilnav.services.gateway.core.resources import ROOT
from surveilnav.services.gateway.event_stream import EventStream
from surveilnav.services.gateway.live import Live
from surveilnav.services.gateway.looks import Looks
from surveilnav.services.gateway.tiles import Tiles

_STATE = 'id: 3f2a90bd-17\nevent: robot\ndata: {"id":"r1","state":{"id":"r1","floor":"0","state":"moving", ...}}\n\n'
_TILE = (
    'id: 3f2a90bd-4\nevent: tile\ndata: {"id":"c0-1/3","state":{"camera":"c0-1","view":3,"jpeg":"/9j/4AAQSkZ..."}}\n\n'
)
#: A camera and one of its views.
_Tile = Annotated[str, Query(pattern=f"^{ID}/[0-9]{{1,4}}$")]
_LastId = Annotated[str | None, Header(max_length=200)]


def _described(what: str, example: str) -> dict[int | str, dict[str, Any]]:
    content = {"text/event-stream": {"schema": {"type": "string"}, "example": example}}
    return {200: {"description": what, "content": content}}


class TileStream(EventStream):
    """Tells a client the pictures that it wants, has cameras asked for them meanwhile, and notes that somebody looks."""

    def __init__(self, tiles: Tiles, last_id: str | None, wanted: list[str], looks: Looks) -> None:
        super().__init__(tiles, last_id, ids=frozenset(wanted))
        self._tiles, self._wanted, self._looks = tiles, wanted, looks

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI side."""
        request = HTTPConnection(scope)

        async def noting(message: Message) -> None:
            for event in message.get("body", b"").split(b"\n\n"):
                self._note(request, event)
            await send(message)

        with self._tiles.wanting(self._wanted):
            await super().__call__(scope, receive, noting)

    def _note(self, request: HTTPConnection, event: bytes) -> None:
        """That somebody looks at the view whose picture an event holds, if it holds one."""
        if b'"jpeg"' not in event:
            return
        for id in self._wanted:
            if b'"%s"' % id.encode() in event:
                camera, _, view = id.rpartition("/")
                self._looks.note(request, camera, int(view), "tile")


def router(live: Live, tiles: Tiles, looks: Looks) -> APIRouter:
    """The streams that a page draws from."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get(
        "/live", response_class=Response, responses=_described("Server-Sent Events: a resource in each", _STATE)
    )
    def state(last_event_id: _LastId = None) -> Response:
        """How everything is, and again whatever changes, as Server-Sent Events: `building`, `readiness`, `floor`, `camera`,
        `robot`, `worker`, `recorder`, `service`, `mission` (the newest 100), `plan`, `cost` (a mission's traffic), `object`
        (without its history), `traffic`, `replay`. The data has the `id` and the `state`: the resource as REST has it, or null
        if it is gone. Of what changes fast a slow client gets the newest state alone. Only `last_seen` of what isn't stale may
        be old."""
        return EventStream(live, last_event_id)

    @router.get("/tiles", response_class=Response, responses=_described("Server-Sent Events: a picture in each", _TILE))
    def pictures(
        of: Annotated[list[_Tile], Query(min_length=1, max_length=shown.MOST)], last_event_id: _LastId = None
    ) -> Response:
        """Small pictures of the views named (`c0-1/3`, at most 32), one connection for all, as Server-Sent Events. Each is
        asked of its camera every 3 seconds while anybody wants it, once for all: that is viewer traffic, no invocation. What
        can't be had says why (`problem`, `detail`)."""
        return TileStream(tiles, last_event_id, sorted(set(of)), looks)

    return router
