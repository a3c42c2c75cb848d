"""``/docs``: the description of all addresses for people, with forms to try them. It needs nothing from elsewhere."""

from __future__ import annotations

from importlib.resources import files
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from fastapi.openapi.docs import get_swagger_ui_html

from surveilnav.services.gateway.core.problems import Problem

#: Swagger UI as the package fastapi-offline carries it.
_STATIC = files("fastapi_offline") / "static"
_TYPES = {"swagger-ui-bundle.js": "text/javascript", "swagger-ui.css": "text/css", "favicon.png": "image/png"}
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def router() -> APIRouter:
    """The page and its files."""
    router = APIRouter(include_in_schema=False)

    @router.get("/docs")
    def page(request: Request) -> Response:
        """Swagger UI on /openapi.json, wherever a proxy has that."""
        root_path = request.scope.get("root_path", "")
        answer = get_swagger_ui_html(
            openapi_url=f"{root_path}/openapi.json",
            title="SurveilNav: REST",
            swagger_js_url=f"{root_path}/docs/swagger-ui-bundle.js",
            swagger_css_url=f"{root_path}/docs/swagger-ui.css",
            swagger_favicon_url=f"{root_path}/docs/favicon.png",
            swagger_ui_parameters={"validatorUrl": None},  # which would send the addresses to its makers
        )
        answer.headers["Content-Security-Policy"] = _POLICY
        return answer

    @router.get("/docs/{name}")
    def file(name: Annotated[str, Path(max_length=64)]) -> Response:
        """A file of the page."""
        if name not in _TYPES:
            raise Problem(404, "no_such_address", f"/docs has no file {name[:64]!r}")
        headers = {"Cache-Control": "max-age=86400"}
        return Response((_STATIC / name).read_bytes(), media_type=_TYPES[name], headers=headers)

    return router
