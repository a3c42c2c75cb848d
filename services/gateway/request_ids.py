"""Gives each HTTP request an id, which is in its answer, in all log lines about it, and in what it causes on the bus."""

from __future__ import annotations

import re
import uuid

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from surveilnav.bus import bound_request_id, is_request_id

HEADER = "X-Request-ID"
#: https://www.w3.org/TR/trace-context/: version, trace id, parent id, flags; later versions may go on after a hyphen.
_TRACEPARENT = re.compile(r"(?!ff)[0-9a-f]{2}-(?P<trace>(?!0{32})[0-9a-f]{32})-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}(-.*)?")
_MAX_TRACEPARENT = 200


class RequestIds:
    """ASGI middleware. A well-formed id in the request's headers is kept; any other is passed over, and a new one made."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        id = scope[HEADER] = _id_in(Headers(scope=scope)) or uuid.uuid4().hex

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)[HEADER] = id
            await send(message)

        with bound_request_id(id):
            await self._app(scope, receive, sent)


def id_of(request: HTTPConnection) -> str:
    """The id that a request was given."""
    return str(request.scope[HEADER])


def _id_in(headers: Headers) -> str:
    """The id in ``X-Request-ID``, or else the trace id in ``traceparent``; "" if neither has one that is well-formed."""
    given, traces = headers.getlist(HEADER), headers.getlist("traceparent")
    if len(given) == 1 and is_request_id(given[0]):
        return given[0]
    trace = _TRACEPARENT.fullmatch(traces[0]) if len(traces) == 1 and len(traces[0]) <= _MAX_TRACEPARENT else None
    return trace["trace"] if trace else ""
