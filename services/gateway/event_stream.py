"""A stream of Server-Sent Events (HTML standard, section 9.2), resumable by Last-Event-ID.

A stream keeps no queue of its own: it reads the shared log at its own pace, so a slow client costs nothing but its
socket's buffers. One that doesn't read at all is dropped.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Collection

import structlog
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.feed import Feed
from surveilnav.services.gateway.problem_answers import answer

#: So often a stream looks whether the gateway is about to stop.
_LOOK_S = 0.5
#: Bytes for a client that doesn't read wait so long; a client that comes back goes on from its last event.
STALLED_S = 20.0
_HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}  # nginx would keep events back


class EventStream(Response):
    """Tells a client the events after ``last_id``, until it goes, stops reading, or the gateway ends. ``ids``: of these
    things alone (on a board)."""

    media_type = "text/event-stream"

    def __init__(
        self, events: Feed, last_id: str | None, stalled_s: float = STALLED_S, ids: Collection[str] | None = None
    ) -> None:
        super().__init__(headers=_HEADERS)
        del self.headers["content-length"]
        self._events, self._last_id, self._stalled_s, self._ids = events, last_id, stalled_s, ids

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI side: one task tells, another notices that the client is gone."""
        try:
            with self._events.waking() as news:
                telling = asyncio.create_task(self._tell(send, news))
                gone = asyncio.create_task(_until_gone(receive))
                try:
                    await asyncio.wait({telling, gone}, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for task in (telling, gone):
                        task.cancel()
                    await asyncio.gather(telling, gone, return_exceptions=True)
        except Problem as problem:
            await answer(Request(scope), problem, {"Retry-After": "10"})(scope, receive, send)

    async def _tell(self, send: Send, news: asyncio.Event) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
        number, quiet_s = await self._begun(send), 0.0
        while not self._events.ended():
            news.clear()
            position, found = self._events.after(number, self._ids)
            told = self._reset(position.number, position.gap) if position.gap else ""
            told += "".join(_block(self._events.id_of(e.number), e.kind, e.data) for e in found)
            if not told and quiet_s >= self._events.beat_s:
                told = f"id: {self._events.id_of(number)}\n{self._events.beat}\n"
            number, quiet_s = found[-1].number if found else position.number, quiet_s + _LOOK_S
            if told:
                quiet_s = 0.0
                if not await self._sent(send, told):
                    return
                await asyncio.sleep(0)  # the others' turn: a long backlog is sent without a wait
            else:
                await _wait(news, _LOOK_S)
        await send({"type": "http.response.body", "body": b"", "more_body": False})

    async def _begun(self, send: Send) -> int:
        """The number after which this client goes on; it is told if events are missing before that."""
        position = self._events.position(self._last_id)
        first = self._reset(position.number, position.gap) if position.gap else "retry: 1000\n\n"
        await self._sent(send, first)
        return position.number

    def _reset(self, number: int, why: str) -> str:
        data = {"why": why, "do": self._events.advice}
        return "retry: 1000\n" + _block(self._events.id_of(number), "reset", json.dumps(data))

    async def _sent(self, send: Send, text: str) -> bool:
        """Whether the client took it, or its buffers did; where it doesn't read, the connection ends."""
        try:
            async with asyncio.timeout(self._stalled_s):
                await send({"type": "http.response.body", "body": text.encode(), "more_body": True})
        except TimeoutError:
            structlog.get_logger().info("drops an event stream that nobody reads", waited_s=self._stalled_s)
            return False
        return True


def _block(id: str, kind: str, data: str) -> str:
    return f"id: {id}\nevent: {kind}\ndata: {data}\n\n"


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _wait(news: asyncio.Event, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await news.wait()
    except TimeoutError:
        return
