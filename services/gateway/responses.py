"""What all routes use: types of parameters, pages of lists, ETags, and problem details (RFC 9457) for failures."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, TypeVar

import structlog
from fastapi import FastAPI, Header, Path, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException

from surveilnav.bus import bound_request_id
from surveilnav.contract import ID_PATTERN
from surveilnav.errors import SurveilNavError
from surveilnav.rest import Items
from surveilnav.services.gateway.core import problems
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.request_ids import HEADER, id_of

T = TypeVar("T")
#: FastAPI's type for the description of an endpoint's responses, by status.
Responses = dict[int | str, dict[str, Any]]

# --- parameters and pages -----------------------------------------------------------------------------------------

Id = Annotated[str, Path(pattern=ID_PATTERN)]
Limit = Annotated[int, Query(ge=1, le=1000)]
Offset = Annotated[int, Query(ge=0)]
Cursor = Annotated[str | None, Query(max_length=100)]


def page_of(everything: list[T], limit: int = 1000, offset: int = 0) -> Items[T]:
    """At most ``limit`` of the items, from index ``offset`` on, with the number of all."""
    return Items(items=everything[offset : offset + limit], total=len(everything))


# --- pictures and arrays ------------------------------------------------------------------------------------------

IfNoneMatch = Annotated[str, Header(max_length=1000)]
NOT_CHANGED: Responses = {304: {"description": "what you have (If-None-Match) is what there is"}}
JPEG: Responses = {200: {"content": {"image/jpeg": {}}, "description": "the picture"}}


def etag_response(body: bytes, media_type: str, headers: dict[str, str], if_none_match: str) -> Response:
    """The body with its ETag, or status 304 if ``If-None-Match`` contains that ETag (RFC 9110, section 13.1.2)."""
    tag = f'"{hashlib.sha256(body).hexdigest()[:20]}"'
    headers = {"Cache-Control": "no-cache", "ETag": tag, **headers}
    known = {t.strip().removeprefix("W/") for t in if_none_match.split(",")}
    if tag in known or "*" in known:
        return Response(status_code=304, headers=headers)
    return Response(body, media_type=media_type, headers=headers)


# --- problems -----------------------------------------------------------------------------------------------------

_SCHEMA = {
    "type": "object",
    "required": ["type", "title", "status", "detail", "instance"],
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
    },
}
#: How the OpenAPI document describes the failures of every endpoint.
PROBLEMS: Responses = {
    "default": {
        "description": "RFC 9457 problem details",
        "content": {problems.MEDIA_TYPE: {"schema": _SCHEMA}},
    }
}


def problem_response(request: Request, problem: Problem, headers: dict[str, str] | None = None) -> Response:
    # ASCII JSON: what a client sent may hold lone surrogates, which UTF-8 can't carry.
    body = json.dumps(problem.body(request.scope["path"]), ensure_ascii=True, default=str)
    return Response(body, problem.status, headers=headers, media_type=problems.MEDIA_TYPE)


def add_problem_handlers(app: FastAPI) -> None:
    """Registers handlers that turn every exception in an endpoint into a response with a problem."""

    @app.exception_handler(Problem)
    async def _problem(request: Request, error: Problem) -> Response:
        return problem_response(request, error)

    @app.exception_handler(RequestValidationError)
    async def _invalid(request: Request, error: RequestValidationError) -> Response:
        return problem_response(request, problems.invalid(list(error.errors())))

    @app.exception_handler(SurveilNavError)
    async def _bus(request: Request, error: SurveilNavError) -> Response:
        return problem_response(request, Problem(503, "bus", str(error)))

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> Response:
        name = {404: "no_such_address", 405: "method_not_allowed"}.get(error.status_code, "http")
        detail = f"{error.detail}: {request.method} {request.scope['path'][:200]}; /openapi.json lists what is there"
        return problem_response(request, Problem(error.status_code, name, detail), dict(error.headers or {}))

    @app.exception_handler(Exception)
    async def _bug(request: Request, error: Exception) -> Response:
        with bound_request_id(id := id_of(request)):  # beyond the middleware that bound it
            structlog.get_logger().error("request failed", path=request.scope["path"], error=repr(error))
        problem = Problem(500, "internal", "the gateway failed; its log says more")
        return problem_response(request, problem, {HEADER: id})
