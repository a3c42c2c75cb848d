"""Bodies that are longer than any request here are refused before anything is read."""

from __future__ import annotations

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from services.gateway.core.problems import Problem
from services.gateway.problem_answers import answer

MAX_BODY_BYTES = 64 * 1024


class BodyLimit:
    """ASGI middleware: 413 for a long body, 411 for one without a length."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        problem = _problem(dict(scope["headers"])) if scope["type"] == "http" else None
        if problem:
            await answer(Request(scope), problem)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


def _problem(headers: dict[bytes, bytes]) -> Problem | None:
    length = headers.get(b"content-length", b"0")
    if b"transfer-encoding" in headers:
        return Problem(411, "length_required", "send the body with a Content-Length")
    if not length.isdigit() or int(length) > MAX_BODY_BYTES:
        return Problem(413, "too_large", f"a request body has at most {MAX_BODY_BYTES} bytes")
    return None
