"""The web side: routes, problem details, the page. Endpoints are plain functions, so FastAPI runs them on threads."""

from __future__ import annotations

import json
from dataclasses import astuple
from pathlib import Path
from typing import Annotated, Any, TypeVar

import structlog
from fastapi import Body, FastAPI, Header, Query, Request, Response
from fastapi import Path as InPath
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Receive, Scope, Send

from services.gateway.core import problems
from services.gateway.core import resources as r
from services.gateway.core.problems import Problem
from services.gateway.service import ROOT, Backend
from surveilnav import __version__
from surveilnav.contract import ID_PATTERN
from surveilnav.errors import SurveilNavError

T = TypeVar("T")
Id = Annotated[str, InPath(pattern=ID_PATTERN)]
Limit = Annotated[int, Query(ge=1, le=1000)]
Offset = Annotated[int, Query(ge=0)]
MAX_BODY_BYTES = 64 * 1024
_PAGE = Path(__file__).with_name("page.html")
#: The page needs nothing from elsewhere, and nothing from elsewhere may run in it.
_PAGE_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_PROBLEM_SCHEMA = {
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
_PROBLEMS: dict[int | str, dict[str, Any]] = {
    "default": {
        "description": "RFC 9457 problem details",
        "content": {problems.MEDIA_TYPE: {"schema": _PROBLEM_SCHEMA}},
    }
}
_PNG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/png": {}}, "description": "the picture"}}
_JPEG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/jpeg": {}}, "description": "the picture"}}


def create_app(backend: Backend) -> FastAPI:
    """The application around ``backend``; serves until its owner closes the node."""
    # FastAPI's own documentation pages load their scripts from elsewhere: none.
    app = FastAPI(
        title="SurveilNav",
        version=__version__,
        description="Surveillance cameras and a robot search a building together.",
        docs_url=None,
        redoc_url=None,
        responses=_PROBLEMS,
    )
    app.add_middleware(_BodyLimit)
    _add_problems(app)
    _add_missions(app, backend)
    _add_building(app, backend)
    _add_health(app, backend)

    @app.get("/", include_in_schema=False)
    def page() -> HTMLResponse:
        return HTMLResponse(_PAGE.read_text(encoding="utf-8"), headers={"Content-Security-Policy": _PAGE_POLICY})

    return app


def _add_missions(app: FastAPI, backend: Backend) -> None:
    @app.post(f"{ROOT}/missions", status_code=202, tags=["missions"])
    def submit(
        goal: r.NewMission,
        response: Response,
        idempotency_key: Annotated[str | None, Header(min_length=1, max_length=255)] = None,
    ) -> r.Mission:
        """Submits a mission. With an Idempotency-Key, a repeated request is the same mission."""
        mission = backend.submit(goal, idempotency_key)
        response.headers["Location"] = f"{ROOT}/missions/{mission.id}"
        return mission

    @app.get(f"{ROOT}/missions", tags=["missions"])
    def missions(limit: Limit = 100, offset: Offset = 0) -> r.Items[r.Mission]:
        """Missions, newest first."""
        return _items(backend.missions(), limit, offset)

    @app.get(f"{ROOT}/missions/{{id}}", tags=["missions"])
    def mission(id: Id) -> r.Mission:
        return backend.mission(id)

    @app.post(f"{ROOT}/missions/{{id}}/cancel", status_code=202, tags=["missions"])
    def cancel(id: Id, reason: Annotated[str, Body(embed=True, max_length=500)] = "") -> r.Mission:
        """Cancels a mission; its robot stops."""
        return backend.cancel(id, reason)

    @app.get(f"{ROOT}/missions/{{id}}/plan", tags=["missions"])
    def plan(id: Id) -> r.MissionPlan:
        """The planner's present plan: waypoint, path, and what else it weighed."""
        return backend.plan(id)


def _add_building(app: FastAPI, backend: Backend) -> None:
    @app.get(f"{ROOT}/cameras", tags=["building"])
    def cameras(limit: Limit = 100, offset: Offset = 0) -> r.Items[r.Camera]:
        return _items(backend.cameras(), limit, offset)

    @app.get(f"{ROOT}/cameras/{{id}}", tags=["building"])
    def camera(id: Id) -> r.Camera:
        return backend.camera(id)

    @app.get(f"{ROOT}/cameras/{{id}}/views/{{view}}.jpg", tags=["building"], response_class=Response, responses=_JPEG)
    def picture(id: Id, view: Annotated[int, InPath(ge=0, le=65535)]) -> Response:
        """A thumbnail that the camera makes for this request: viewer traffic, not an invocation."""
        return Response(backend.thumbnail(id, view), media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @app.get(f"{ROOT}/robots", tags=["building"])
    def robots(limit: Limit = 100, offset: Offset = 0) -> r.Items[r.Robot]:
        return _items(backend.robots(), limit, offset)

    @app.get(f"{ROOT}/perception", tags=["building"])
    def perception(limit: Limit = 100, offset: Offset = 0) -> r.Items[r.Worker]:
        """Perception workers, the backend that each runs, and why that one."""
        return _items(backend.workers(), limit, offset)

    @app.get(f"{ROOT}/floors", tags=["building"])
    def floors(limit: Limit = 100, offset: Offset = 0) -> r.Items[r.Floor]:
        return _items(backend.floors(), limit, offset)

    @app.get(f"{ROOT}/floors/{{id}}/layers/{{layer}}.png", tags=["building"], response_class=Response, responses=_PNG)
    def layer(
        id: Id, layer: Annotated[str, InPath(max_length=64)], target: Annotated[str, Query(max_length=200)] = ""
    ) -> Response:
        """A map layer, north up, one pixel a cell: occupancy (slate), explored (pale blue), frontier (orange), or
        value (viridis from the lowest to the highest value, for ``target``; default: the newest mission's). All
        else is transparent. ``X-Surveilnav-Grid`` holds the world position of the lower left corner, the cell
        size [m], rows and columns; ``X-Surveilnav-Range`` the ends of the value scale.
        """
        picture, revision = backend.layer(id, layer, target.strip())
        grid = picture.grid
        headers = {
            "Cache-Control": "no-cache",
            "X-Surveilnav-Revision": str(revision),
            "X-Surveilnav-Grid": " ".join(f"{v:g}" for v in astuple(grid)),
        }
        if picture.low is not None and picture.high is not None:
            headers["X-Surveilnav-Range"] = f"{picture.low:.6g} {picture.high:.6g}"
        return Response(picture.png, media_type="image/png", headers=headers)

    @app.get(f"{ROOT}/objects", tags=["building"])
    def objects(
        floor: Annotated[str | None, Query(pattern=ID_PATTERN)] = None,
        label: Annotated[str | None, Query(max_length=200)] = None,
        limit: Limit = 100,
        offset: Offset = 0,
    ) -> r.Items[r.Object]:
        """Objects with their histories, by floor, last seen first."""
        return _items(backend.objects(floor, label), limit, offset)

    @app.get(f"{ROOT}/traffic", tags=["building"])
    def traffic() -> r.Traffic:
        """Bytes offered, delivered and on the wire."""
        return backend.traffic()


def _add_health(app: FastAPI, backend: Backend) -> None:
    @app.get("/healthz", tags=["health"])
    def healthz() -> dict[str, str]:
        """This process lives. Whether a mission could run is /readyz."""
        return {"status": "ok"}

    @app.get("/readyz", tags=["health"])
    def readyz() -> r.Readiness:
        """Whether a mission could run now: 200, or 503 with what is missing."""
        readiness = backend.readiness()
        if not readiness.ready:
            raise Problem(503, "not_ready", f"missing: {', '.join(readiness.missing)}", **readiness.model_dump())
        return readiness


def _add_problems(app: FastAPI) -> None:
    @app.exception_handler(Problem)
    async def problem(request: Request, error: Problem) -> Response:
        return _problem(request, error)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> Response:
        return _problem(request, problems.invalid(list(error.errors())))

    @app.exception_handler(SurveilNavError)
    async def ours(request: Request, error: SurveilNavError) -> Response:
        return _problem(request, Problem(503, "bus", str(error)))

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> Response:
        name = {404: "no_such_address", 405: "method_not_allowed"}.get(error.status_code, "http")
        detail = f"{error.detail}: {request.method} {request.url.path[:200]}; /openapi.json lists what is there"
        return _problem(request, Problem(error.status_code, name, detail), dict(error.headers or {}))

    @app.exception_handler(Exception)
    async def bug(request: Request, error: Exception) -> Response:
        structlog.get_logger().error("request failed", path=request.url.path, error=repr(error))
        return _problem(request, Problem(500, "internal", "the gateway failed; its log says more"))


def _problem(request: Request, problem: Problem, headers: dict[str, str] | None = None) -> Response:
    # ASCII JSON: what a client sent may hold lone surrogates, which no UTF-8 can carry.
    body = json.dumps(problem.body(request.url.path), ensure_ascii=True, default=str)
    return Response(body, problem.status, headers=headers, media_type=problems.MEDIA_TYPE)


def _items(all_of_them: list[T], limit: int, offset: int) -> r.Items[T]:
    return r.Items(items=all_of_them[offset : offset + limit], total=len(all_of_them))


class _BodyLimit:
    """Refuses bodies that are longer than any request here, before anything is read."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            headers = dict(scope["headers"])
            length = headers.get(b"content-length", b"0")
            problem = None
            if b"transfer-encoding" in headers:
                problem = Problem(411, "length_required", "send the body with a Content-Length")
            elif not length.isdigit() or int(length) > MAX_BODY_BYTES:
                problem = Problem(413, "too_large", f"a request body has at most {MAX_BODY_BYTES} bytes")
            if problem:
                await _problem(Request(scope), problem)(scope, receive, send)
                return
        await self.app(scope, receive, send)
