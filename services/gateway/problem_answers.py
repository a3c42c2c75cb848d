"""Every failure becomes problem details (RFC 9457)."""

from __future__ import annotations

import json
from typing import Any

import structlog
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException

from surveilnav.errors import SurveilNavError
from surveilnav.services.gateway.core import problems
from surveilnav.services.gateway.core.problems import Problem

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
#: What the OpenAPI document says of every endpoint's failures.
RESPONSES: dict[int | str, dict[str, Any]] = {
    "default": {
        "description": "RFC 9457 problem details",
        "content": {problems.MEDIA_TYPE: {"schema": _SCHEMA}},
    }
}


def answer(request: Request, problem: Problem, headers: dict[str, str] | None = None) -> Response:
    """The HTTP answer that says ``problem``."""
    # ASCII JSON: what a client sent may hold lone surrogates, which no UTF-8 can carry.
    body = json.dumps(problem.body(request.scope["path"]), ensure_ascii=True, default=str)
    return Response(body, problem.status, headers=headers, media_type=problems.MEDIA_TYPE)


def answer_failures(app: FastAPI) -> None:
    """Makes every exception of the application's endpoints an answer."""

    @app.exception_handler(Problem)
    async def _told(request: Request, error: Problem) -> Response:
        return answer(request, error)

    @app.exception_handler(RequestValidationError)
    async def _invalid(request: Request, error: RequestValidationError) -> Response:
        return answer(request, problems.invalid(list(error.errors())))

    @app.exception_handler(SurveilNavError)
    async def _ours(request: Request, error: SurveilNavError) -> Response:
        return answer(request, Problem(503, "bus", str(error)))

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> Response:
        name = {404: "no_such_address", 405: "method_not_allowed"}.get(error.status_code, "http")
        detail = f"{error.detail}: {request.method} {request.scope['path'][:200]}; /openapi.json lists what is there"
        return answer(request, Problem(error.status_code, name, detail), dict(error.headers or {}))

    @app.exception_handler(Exception)
    async def _bug(request: Request, error: Exception) -> Response:
        structlog.get_logger().error("request failed", path=request.scope["path"], error=repr(error))
        return answer(request, Problem(500, "internal", "the gateway failed; its log says more"))
