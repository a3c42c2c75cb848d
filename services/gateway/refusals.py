"""What is refused by its headers, before anything is read: a foreign host, a body longer than any request here."""

from __future__ import annotations

from collections.abc import Callable

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from services.gateway.core.hosts import foreign
from services.gateway.core.problems import Problem
from services.gateway.problem_answers import answer

MAX_BODY_BYTES = 64 * 1024


class Refusals:
    """ASGI middleware: ``problem`` says what is wrong with a request's headers; None: nothing."""

    def __init__(self, app: ASGIApp, problem: Callable[[Headers], Problem | None]) -> None:
        self._app, self._problem = app, problem

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        problem = self._problem(Headers(scope=scope)) if scope["type"] == "http" else None
        if problem:
            await answer(Request(scope), problem)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


def check(allowed: frozenset[str] | None) -> Callable[[Headers], Problem | None]:
    """The check of a gateway that answers under the ``allowed`` names (None: under any)."""
    return lambda headers: _foreign_host(headers, allowed) or _long_body(headers)


def _foreign_host(headers: Headers, allowed: frozenset[str] | None) -> Problem | None:
    """421: the request is for somebody else."""
    host = foreign(headers.getlist("host"), allowed)
    if host is None:
        return None
    names = ", ".join(sorted(allowed or ()))
    return Problem(
        421, "foreign_host",
        f"this gateway answers as {names}, and was asked for as {host[:200]!r}. If people shall reach it by that name, add it "
        "to SURVEILNAV_GATEWAY__ALLOWED_HOSTS",
    )  # fmt: skip


def _long_body(headers: Headers) -> Problem | None:
    """413 for a long body, 411 for one without a length."""
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers:
        return Problem(411, "length_required", "send the body with a Content-Length")
    if not (length.isascii() and length.isdigit()) or int(length) > MAX_BODY_BYTES:
        return Problem(413, "too_large", f"a request body has at most {MAX_BODY_BYTES} bytes")
    return None
