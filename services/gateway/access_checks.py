"""Answers a request only if who sends it has the role that its address needs, and logs what was commanded by whom."""

from __future__ import annotations

from http.cookies import CookieError, SimpleCookie

import structlog
from anyio import move_on_after, to_thread
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from surveilnav.bus.logs import RateLimiter
from surveilnav.services.gateway.authentication import Authentication
from surveilnav.services.gateway.core.hosts import Networks
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.requester import Person, address_of, set_person
from surveilnav.services.gateway.responses import problem_response
from surveilnav.services.gateway.roles import needed_role

COOKIE = "surveilnav_session"
#: Requests with these methods command nothing, and aren't logged.
_ASKING = ("GET", "HEAD", "OPTIONS")
_MAX_KEY = 200
#: How long a stream may go on after its key was revoked.
_REVOKED_S = 2.0


class AccessChecks:
    """ASGI middleware.

    Args:
        authentication: knows the keys; None: everybody may do everything.
        trusted_proxies: proxies whose ``X-Forwarded-For`` is believed.
    """

    def __init__(self, app: ASGIApp, authentication: Authentication | None, trusted_proxies: Networks = ()) -> None:
        self._app, self._authentication, self._trusted_proxies = app, authentication, trusted_proxies
        self._log, self._refusals = structlog.get_logger(), RateLimiter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] != "websocket":  # there is none: what isn't checked isn't answered
                await self._app(scope, receive, send)
            return
        client = address_of(HTTPConnection(scope), self._trusted_proxies)
        try:
            person = await self._admitted(scope, client)
        except Problem as problem:
            self._log_refusal(scope, client, problem)
            await problem_response(Request(scope), problem, _headers_of(problem))(scope, receive, send)
            return
        set_person(scope, person)
        if scope["method"] not in _ASKING:
            send = self._logging(scope, client, person, send)
        elif person is not None and self._authentication is not None:
            receive = _until_revoked(receive, Headers(scope=scope), person, self._authentication)
        await self._app(scope, receive, send)

    async def _admitted(self, scope: Scope, client: str) -> Person | None:
        """Who sends an admissible request; None: nobody needs to say. Raises Problem for any other request."""
        if self._authentication is None or (needed := needed_role(scope["method"], path_of(scope))) is None:
            return None
        person = await _person(Headers(scope=scope), client, self._authentication)
        if person.role < needed:
            raise Problem(
                403,
                "role",
                f"{scope['method']} {scope['path'][:200]} needs the role {needed.name}; the key {person.name!r} has the role "
                f"{person.role.name}",
            )
        return person

    def _logging(self, scope: Scope, client: str, person: Person | None, send: Send) -> Send:
        """``send``, and a line in the log when the answer begins."""

        async def logged(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._log.info(
                    "commanded",
                    key=person.name if person else "",
                    client=client,
                    method=scope["method"],
                    path=scope["path"][:200],
                    status=message["status"],
                )
            await send(message)

        return logged

    def _log_refusal(self, scope: Scope, client: str, problem: Problem) -> None:
        if self._refusals.try_acquire(f"{client} {problem.name}"):
            facts = {"client": client, "method": scope["method"], "path": scope["path"][:200]}
            self._log.warning("refused", problem=problem.name, why=problem.detail, **facts)


def _until_revoked(receive: Receive, headers: Headers, person: Person, authentication: Authentication) -> Receive:
    """``receive``, which tells a stream that its client has gone once its key is revoked or its session has ended."""
    token = "" if headers.get("authorization") else session_token(headers)

    async def received() -> Message:
        while authentication.session_owner(token) == person if token else authentication.is_current(person):
            with move_on_after(_REVOKED_S):
                return await receive()
        return {"type": "http.disconnect"}

    return received


async def _person(headers: Headers, client: str, authentication: Authentication) -> Person:
    """Whose key or session is in the headers. Raises Problem 401 if there is none, 429 after too many wrong ones."""
    kind, _, presented = headers.get("authorization", "").partition(" ")
    presented = presented.strip()
    if kind.lower() == "bearer" and presented:
        if len(presented) > _MAX_KEY:
            presented = ""  # no key is so long; counted as a wrong one
        if (known := authentication.known_owner(presented)) is not None:
            return known
        return await to_thread.run_sync(authentication.key_owner, presented, client)
    if token := session_token(headers):
        if (owner := authentication.session_owner(token)) is not None:
            return owner
        raise Problem(401, "session_ended", "this session has ended: sign in again with a key")
    raise Problem(
        401,
        "key_needed",
        "this gateway answers only with a key: Authorization: Bearer KEY, or SURVEILNAV_API_KEY for `surveilnav` and the client. "
        "Its administrator makes one by `surveilnav security key add NAME --role viewer`",
    )


def session_token(headers: Headers) -> str:
    """The text of the session's cookie; empty if there is none."""
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value[:_MAX_KEY] if found else ""


def path_of(scope: Scope) -> str:
    """A request's path as the routes have it: without the path at which a proxy serves the gateway."""
    path, root = str(scope["path"]), str(scope.get("root_path", ""))
    return path[len(root) :] if root and path.startswith(f"{root}/") else path


def _headers_of(problem: Problem) -> dict[str, str]:
    if problem.status == 401:
        return {"WWW-Authenticate": 'Bearer realm="surveilnav"'}
    return {"Retry-After": str(problem.more["retry_after_s"])} if "retry_after_s" in problem.more else {}
