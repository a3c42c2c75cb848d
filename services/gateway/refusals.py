"""What is refused by its headers, before anything is read: a foreign host or page, a body longer than any request here."""

from __future__ import annotations

from collections.abc import Callable

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from surveilnav.services.gateway.core.hosts import foreign, foreign_origin
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.problem_answers import answer

MAX_BODY_BYTES = 64 * 1024
#: Methods that change nothing, whose answers a foreign page can't read.
_READS = ("GET", "HEAD", "OPTIONS")


class Refusals:
    """ASGI middleware: ``problem`` says what is wrong with a request's method and headers; None: nothing."""

    def __init__(self, app: ASGIApp, problem: Callable[[str, Headers], Problem | None]) -> None:
        self._app, self._problem = app, problem

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        problem = self._problem(scope["method"], Headers(scope=scope)) if scope["type"] == "http" else None
        if problem:
            await answer(Request(scope), problem)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


def check(allowed: frozenset[str] | None) -> Callable[[str, Headers], Problem | None]:
    """The check of a gateway that answers under the ``allowed`` names (None: under any)."""
    return lambda method, headers: (
        _foreign_host(headers, allowed) or _foreign_page(method, headers, allowed) or _long_body(headers)
    )


def _foreign_host(headers: Headers, allowed: frozenset[str] | None) -> Problem | None:
    """421: the request is for somebody else."""
    host = foreign(headers.getlist("host"), allowed)
    if host is None:
        return None
    names = ", ".join(sorted(allowed or ()))
    return Problem(
        421,
        "foreign_host",
        f"this gateway answers as {names}, and was asked for as {host[:200]!r}. If people shall reach it by that name, add it "
        "to SURVEILNAV_GATEWAY__ALLOWED_HOSTS",
    )


def _foreign_page(method: str, headers: Headers, allowed: frozenset[str] | None) -> Problem | None:
    """403: a page of another site has somebody's browser change something here."""
    if method in _READS:
        return None
    origin = foreign_origin(headers.getlist("origin"), allowed)
    if origin is None:
        return None
    return Problem(
        403,
        "foreign_page",
        f"a page of {origin[:200]!r} asked for this. If it is yours, add its name to SURVEILNAV_GATEWAY__ALLOWED_HOSTS",
    )


def _long_body(headers: Headers) -> Problem | None:
    """413 for a long body, 411 for one without a length."""
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers:
        return Problem(411, "length_required", "send the body with a Content-Length")
    if not (length.isascii() and length.isdigit()) or int(length) > MAX_BODY_BYTES:
        return Problem(413, "too_large", f"a request body has at most {MAX_BODY_BYTES} bytes")
    return None
