"""Server-Sent Events (HTML standard, section 9.2), resumable by Last-Event-ID; ``/events``, ``/live`` and ``/tiles``.

Streams have no queues: each reads a shared log at its own pace, so a slow client takes no memory but its socket's buffers. A
client that stops reading is disconnected; when it connects again, it continues after its last event.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Collection, Sequence
from typing import Annotated

import structlog
from fastapi import APIRouter, Header, Query, Response
from sse_starlette import EventSourceResponse, ServerSentEvent
from sse_starlette.sse import AppStatus, SendTimeoutError
from starlette.requests import HTTPConnection, Request
from starlette.types import Receive, Scope, Send

from surveilnav.contract import ID
from surveilnav.rest import ROOT
from surveilnav.services.gateway.access_log import AccessLog
from surveilnav.services.gateway.core.change_log import LogEntry, ReadPosition
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.responses import Responses, problem_response
from surveilnav.services.gateway.stream_sources import BuildingEvents, LiveStates, StreamSource
from surveilnav.services.gateway.tiles import MAX_TILES, CameraTiles

#: How often a stream without new entries checks whether the gateway is about to stop.
_WAIT_S = 0.5
#: A client that hasn't read its bytes for this time is disconnected.
STALLED_S = 20.0
_SEP = "\n"
#: How long browsers wait before they connect again.
_RETRY_MS = 1000
# Our streams end by themselves when the server is about to stop, at the end of an event. sse-starlette would cancel them.
AppStatus.enable_automatic_graceful_drain = False


class EventStream(EventSourceResponse):
    """Sends a client the entries of ``source`` after ``last_id``, until the client leaves or stops reading, or the gateway ends.

    ``ids``: only entries with these ids are sent; None: all. ``stalled_s``: how long the client may leave bytes unread.
    """

    def __init__(
        self,
        source: StreamSource,
        last_id: str | None,
        ids: Collection[str] | None = None,
        stalled_s: float = STALLED_S,
    ) -> None:
        # no ping of the library's: ours carries the position, and is sent only where there is nothing else to send
        super().__init__(self._blocks(), ping=0, sep=_SEP, send_timeout=stalled_s)
        self._source, self._last_id, self._ids = source, last_id, ids
        self._news = asyncio.Event()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI application. If too many streams are open, it answers with a problem."""
        try:
            with self._source.waking() as self._news:
                await super().__call__(scope, receive, send)
        except Problem as problem:
            await problem_response(Request(scope), problem, {"Retry-After": "10"})(scope, receive, send)
        except SendTimeoutError:
            structlog.get_logger().info("drops an event stream that nobody reads", waited_s=self.send_timeout)

    def _before_send(self, entries: Sequence[LogEntry]) -> None:
        """Called with entries that are about to be sent."""

    async def _blocks(self) -> AsyncIterator[bytes]:
        source = self._source
        position = source.position(self._last_id)
        yield self._reset(position) if position.gap else _block(retry=_RETRY_MS)
        number, quiet_s = position.number, 0.0
        while not source.ended():
            self._news.clear()
            position, entries = source.after(number, self._ids)
            number = entries[-1].number if entries else position.number
            blocks = [self._reset(position)] if position.gap else []
            blocks += [_block(e.data, event=e.kind, id=source.id_of(e.number)) for e in entries]
            if not blocks and quiet_s >= source.beat_s:
                blocks = [self._beat(number)]
            if blocks:
                self._before_send(entries)
                yield b"".join(blocks)
                quiet_s = 0.0
                await asyncio.sleep(0)  # lets others run: a long backlog is sent without a wait
            else:
                await _wait(self._news, _WAIT_S)
                quiet_s += _WAIT_S

    def _reset(self, position: ReadPosition) -> bytes:
        data = json.dumps({"why": position.gap, "do": self._source.advice})
        return _block(data, event="reset", id=self._source.id_of(position.number), retry=_RETRY_MS)

    def _beat(self, number: int) -> bytes:
        id, event = self._source.id_of(number), self._source.beat_event
        return _block("{}", event=event, id=id) if event else _block(id=id)


class TileStream(EventStream):
    """Sends a client the small pictures that it wants, and records the access. While it is open, cameras are asked for them."""

    def __init__(self, tiles: CameraTiles, last_id: str | None, wanted: list[str], access_log: AccessLog) -> None:
        super().__init__(tiles, last_id, ids=frozenset(wanted))
        self._tiles, self._wanted, self._access_log = tiles, wanted, access_log
        self._connection: HTTPConnection | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self._connection = HTTPConnection(scope)
        with self._tiles.wanting(self._wanted):
            await super().__call__(scope, receive, send)

    def _before_send(self, entries: Sequence[LogEntry]) -> None:
        """Records the pictures among the entries."""
        assert self._connection is not None
        for state in (json.loads(entry.data)["state"] for entry in entries):
            if state and "jpeg" in state:
                self._access_log.record(self._connection, state["camera"], state["view"], "tile")


def _block(
    data: str | None = None, *, event: str | None = None, id: str | None = None, retry: int | None = None
) -> bytes:
    return ServerSentEvent(data, event=event, id=id, retry=retry, sep=_SEP).encode()


async def _wait(news: asyncio.Event, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await news.wait()
    except TimeoutError:
        return


# --- addresses ----------------------------------------------------------------------------------------------------

_EVENT = 'id: 3f2a90bd-17\nevent: mission\ndata: {"id":"m-1","what":"active","time":"2026-01-31T10:00:00Z","target":"tv"}\n\n'
_STATE = 'id: 3f2a90bd-17\nevent: robot\ndata: {"id":"r1","state":{"id":"r1","floor":"0","state":"moving", ...}}\n\n'
_TILE = (
    'id: 3f2a90bd-4\nevent: tile\ndata: {"id":"c0-1/3","state":{"camera":"c0-1","view":3,"jpeg":"/9j/4AAQSkZ..."}}\n\n'
)
#: A camera and one of its views.
_Tile = Annotated[str, Query(pattern=f"^{ID}/[0-9]{{1,4}}$")]
_LastId = Annotated[str | None, Header(max_length=200)]


def _described(what: str, example: str) -> Responses:
    content = {"text/event-stream": {"schema": {"type": "string"}, "example": example}}
    return {200: {"description": what, "content": content}}


def router(events: BuildingEvents, live: LiveStates, tiles: CameraTiles, access_log: AccessLog) -> APIRouter:
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get(
        "/events",
        name="stream",
        response_class=Response,
        responses=_described("Server-Sent Events; the data of each is an Event as JSON", _EVENT),
    )
    def event_stream(last_event_id: _LastId = None) -> Response:
        """Changes, as Server-Sent Events: `mission`, `object`, `camera`, `robot`, `service`, `removal`. To miss none, send
        the id of the last event as `Last-Event-ID` when you connect again (browsers do). `reset` says that this is your first
        connection, or that some events aren't kept any more: read the state again."""
        return EventStream(events, last_event_id)

    @router.get(
        "/live",
        name="state",
        response_class=Response,
        responses=_described("Server-Sent Events: a resource in each", _STATE),
    )
    def live_stream(last_event_id: _LastId = None) -> Response:
        """The state of everything, and then whatever changes, as Server-Sent Events: `building`, `readiness`,
        `floor`, `camera`, `robot`, `worker`, `recorder`, `service`, `mission` (the newest 100), `plan`, `cost` (a
        mission's traffic), `object` (without its history), `traffic`, `replay`, `removal`. The data has the `id` and
        the `state`: the resource as in REST, or null if it is gone. A slow client gets only the newest state of what
        changes fast. A resource isn't sent again if only its `last_seen` changes."""
        return EventStream(live, last_event_id)

    @router.get(
        "/tiles",
        name="pictures",
        response_class=Response,
        responses=_described("Server-Sent Events: a picture in each", _TILE),
    )
    def tile_stream(
        of: Annotated[list[_Tile], Query(min_length=1, max_length=MAX_TILES)], last_event_id: _LastId = None
    ) -> Response:
        """Small pictures of the views named (`c0-1/3`, at most 32), over one connection, as Server-Sent Events. Each is
        requested from its camera every 3 seconds while anybody watches, once for all viewers. That counts as viewer traffic and
        doesn't invoke the camera. If there is no picture, the data says why (`problem`, `detail`)."""
        return TileStream(tiles, last_event_id, sorted(set(of)), access_log)

    return router
