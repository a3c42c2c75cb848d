"""The addresses at which a page exchanges a key for a session, whose cookie goes with event streams and pictures, too."""

from __future__ import annotations

import structlog
from fastapi import APIRouter, Request, Response

from surveilnav.rest import ROOT, NewSession, Session
from surveilnav.services.gateway.access_checks import COOKIE, session_token
from surveilnav.services.gateway.authentication import SESSION_S, Authentication
from surveilnav.services.gateway.core.hosts import Networks
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.requester import Person, address_of


def router(authentication: Authentication | None, trusted_proxies: Networks) -> APIRouter:
    router = APIRouter(prefix=ROOT, tags=["access"])

    @router.get("/session", name="session")
    def session(request: Request) -> Session:
        """Whether a key is needed here, and whose session this is."""
        if authentication is None:
            return Session(needed=False)
        return _resource(authentication.session_owner(session_token(request.headers)))

    @router.post("/session")
    def sign_in(request: Request, response: Response, new: NewSession) -> Session:
        """Opens a session for a key. The answer sets a cookie, which is good until it ends, or until its key is revoked."""
        if authentication is None:
            raise Problem(409, "no_keys", "this gateway answers without keys")
        client = address_of(request, trusted_proxies)
        token, person = authentication.open_session(new.key, client)
        structlog.get_logger().info("signed in", key=person.name, client=client)
        # For this gateway alone, and hidden from scripts; other sites' pages can't make a browser send it.
        response.set_cookie(
            COOKIE,
            token,
            max_age=int(SESSION_S),
            path=_path(request),
            httponly=True,
            samesite="strict",
            secure=_is_encrypted(request),
        )
        return _resource(person)

    @router.delete("/session", status_code=204)
    def sign_out(request: Request, response: Response) -> None:
        """Ends the session."""
        if authentication is not None:
            authentication.close_session(session_token(request.headers))
        response.delete_cookie(COOKIE, path=_path(request), httponly=True, samesite="strict")

    return router


def _path(request: Request) -> str:
    """The path below which the cookie is sent: the gateway's own, where a proxy serves others beside it."""
    return str(request.scope.get("root_path", "")) or "/"


def _is_encrypted(request: Request) -> bool:
    """Whether the page came encrypted. If a proxy decrypts, only the page's origin shows it."""
    return request.url.scheme == "https" or request.headers.get("origin", "").startswith("https://")


def _resource(person: Person | None) -> Session:
    return Session(needed=True, name=person.name if person else "", role=person.role.name if person else None)
