"""Checks the host, the origin and the body length in a request's headers, before the body is read; adds headers to answers."""

from __future__ import annotations

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from surveilnav.services.gateway.core.hosts import foreign_host, foreign_origin
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.responses import problem_response

#: What browsers are told of every answer: show it in no frame and to no other site, run nothing in it, keep no copy.
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
MAX_BODY_BYTES = 64 * 1024
#: Methods whose origin isn't checked: they change nothing, and browsers keep pages of other sites from reading the answers.
_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


class RequestChecks:
    """ASGI middleware that answers a request with a problem if a check fails.

    ``allowed``: the host names that the gateway answers to (None: any).
    """

    def __init__(self, app: ASGIApp, allowed: frozenset[str] | None) -> None:
        self._app, self._allowed = app, allowed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        problem = self._problem(scope["method"], Headers(scope=scope)) if scope["type"] == "http" else None
        if problem:
            await problem_response(Request(scope), problem)(scope, receive, _hardened(send))
        else:
            await self._app(scope, receive, _hardened(send))

    def _problem(self, method: str, headers: Headers) -> Problem | None:
        return self._check_host(headers) or self._check_origin(method, headers) or _check_body(headers)

    def _check_host(self, headers: Headers) -> Problem | None:
        """Problem 421 if the request is for another host."""
        host = foreign_host(headers.getlist("host"), self._allowed)
        if host is None:
            return None
        names = ", ".join(sorted(self._allowed or ()))
        return Problem(
            421,
            "foreign_host",
            f"this gateway answers as {names}, and was asked for as {host[:200]!r}. If people shall reach it by that name, add "
            "it to SURVEILNAV_GATEWAY__ALLOWED_HOSTS",
        )

    def _check_origin(self, method: str, headers: Headers) -> Problem | None:
        """Problem 403 if a page of another site makes a browser send a request that changes something."""
        if method in _SAFE_METHODS:
            return None
        origin = foreign_origin(headers.getlist("origin"), self._allowed)
        if origin is None:
            return None
        return Problem(
            403,
            "foreign_page",
            f"a page of {origin[:200]!r} asked for this. If it is yours, add its name to SURVEILNAV_GATEWAY__ALLOWED_HOSTS",
        )


def _hardened(send: Send) -> Send:
    """``send``, with the headers that every answer has, unless it has its own."""

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return sent


def _check_body(headers: Headers) -> Problem | None:
    """Problem 413 for a body that is too long, 411 for one without a length."""
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers:
        return Problem(411, "length_required", "send the body with a Content-Length")
    if not (length.isascii() and length.isdigit()) or int(length) > MAX_BODY_BYTES:
        return Problem(413, "too_large", f"a request body has at most {MAX_BODY_BYTES} bytes")
    return None
