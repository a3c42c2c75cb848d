"""The addresses of the page. Each has a secret in its path, so that no other page can ask for it."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from surveilnav.cli.calibration_page.session import Pairs, Session
from surveilnav.errors import SurveilNavError
from surveilnav.services.gateway.core.hosts import foreign_host, foreign_origin

_STATIC = Path(__file__).parent / "static"
_GATEWAY = files("surveilnav.services.gateway") / "static"
#: Of the gateway's page: its colours, buttons and theme.
_SHARED = (
    "icon.svg",
    "page/icons.js",
    "page/theme.js",
    "page/ui.js",
    "style/parts.css",
    "style/tokens.css",
    "vendor/htm-preact-standalone.module.js",
)
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_NAMES = frozenset({"127.0.0.1", "localhost"})
_MAX_BODY_BYTES = 256 << 10
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address has the secret
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def create_app(session: Session, secret: str) -> Starlette:
    """The web application below ``/{secret}/``. A mistake of the user is 409 with ``{"message": ...}``."""

    async def page(_: Request) -> Response:
        return Response((_STATIC / "page.html").read_bytes(), media_type="text/html; charset=utf-8")

    async def page_file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in _page_files():
            return _refused(404, "the page has no such file")
        return Response(_page_files()[name], media_type=_TYPES[Path(name).suffix])

    async def state(_: Request) -> Response:
        return JSONResponse(await run_in_threadpool(session.state))

    async def plan(_: Request) -> Response:
        return Response(await run_in_threadpool(session.plan_png), media_type="image/png")

    async def picture(request: Request) -> Response:
        jpeg = await run_in_threadpool(session.picture, request.method == "POST")
        return Response(jpeg, media_type="image/jpeg")

    async def solve(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(session.solve, await _pairs(request)))

    async def save_pose(request: Request) -> Response:
        return JSONResponse({"message": await run_in_threadpool(session.save_pose, await _pairs(request))})

    async def save_clicks(request: Request) -> Response:
        return JSONResponse({"message": await run_in_threadpool(session.save_clicks, await _pairs(request))})

    addresses = [
        Route("/", page),
        Route("/static/{name:path}", page_file),
        Route("/state", state),
        Route("/plan", plan),
        Route("/picture", picture, methods=["GET", "POST"]),
        Route("/solution", solve, methods=["PUT"]),
        Route("/pose", save_pose, methods=["POST"]),
        Route("/clicks", save_clicks, methods=["POST"]),
    ]
    app = Starlette(
        routes=[Mount(f"/{secret}", routes=addresses)],
        exception_handlers={
            404: lambda _request, _error: _refused(
                404, "open the address that the command printed, with all its letters"
            ),
            SurveilNavError: lambda _request, error: _refused(409, str(error)),
            ValidationError: lambda _request, error: _refused(422, _first_fault(error)),
        },
    )
    app.add_middleware(_Checks)
    return app


class _Checks:
    """ASGI middleware: it answers to this machine's own names only, to no other site's page, and reads no endless body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: dict) -> None:  # type: ignore[type-arg]
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    *((k.lower().encode(), v.encode()) for k, v in _HEADERS.items()),
                ]
            await send(message)

        refused = _refusal(Headers(scope=scope))
        await (refused or self._app)(scope, receive, send_with_headers)  # type: ignore[arg-type]


def _refusal(headers: Headers) -> Response | None:
    if foreign_host(headers.getlist("host"), _NAMES) is not None:
        return _refused(421, "this page answers as 127.0.0.1 or localhost only")
    if foreign_origin(headers.getlist("origin"), _NAMES) is not None:
        return _refused(403, "a page of another site asked for this")
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers or not length.isdecimal() or int(length) > _MAX_BODY_BYTES:
        return _refused(413, f"a request has at most {_MAX_BODY_BYTES} bytes, and says how many")
    return None


async def _pairs(request: Request) -> Pairs:
    return Pairs.model_validate_json(await request.body())


def _first_fault(error: ValidationError) -> str:
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"


def _refused(status: int, message: str) -> Response:
    return JSONResponse({"message": message}, status)


@cache
def _page_files() -> dict[str, bytes]:
    own = {f"calibration/{path.name}": path.read_bytes() for path in (_STATIC / "calibration").iterdir()}
    return own | {name: _GATEWAY.joinpath(*name.split("/")).read_bytes() for name in _SHARED}
