"""Pages for people: ``/``, from the files in ``static``, and ``/docs``. They load nothing from other servers."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Request, Response
from fastapi import Path as InPath
from fastapi.openapi.docs import get_swagger_ui_html

from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.responses import IfNoneMatch, etag_response

_FOLDER = Path(__file__).parent / "static"
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
#: Only our own files may be run as scripts or used as styles, whatever data from the bus contain.
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}
#: Modules of views that few people open. They aren't preloaded.
_LOADED_LATER = "page/cloud/"
_FOR_GOOD = "max-age=31536000, immutable"
#: Swagger UI as the package fastapi-offline carries it.
_SWAGGER = files("fastapi_offline") / "static"
_SWAGGER_TYPES = {"swagger-ui-bundle.js": "text/javascript", "swagger-ui.css": "text/css", "favicon.png": "image/png"}
_SWAGGER_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


@dataclass(frozen=True, slots=True)
class _PageFiles:
    """The page and its files, read once. ``version``: a digest of all files, which is part of their addresses."""

    page: str
    files: dict[str, bytes]
    version: str


@cache
def _read() -> _PageFiles:
    paths = [p for p in sorted(_FOLDER.rglob("*")) if p.suffix in _TYPES]
    found = {p.relative_to(_FOLDER).as_posix(): p.read_bytes() for p in paths}
    version = hashlib.sha256(b"".join(n.encode() + b"\0" + data for n, data in found.items())).hexdigest()[:16]
    at_once = [n for n in found if n.endswith(".js") and not n.startswith(_LOADED_LATER)]
    preloads = "\n".join(f'<link rel="modulepreload" href="static/{version}/{name}">' for name in at_once)
    text = (_FOLDER / "page.html").read_text(encoding="utf-8")
    return _PageFiles(text.replace("{{version}}", version).replace("{{preloads}}", preloads), found, version)


def router() -> APIRouter:
    """The page, the documentation of all addresses, and their files."""
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    def page(if_none_match: IfNoneMatch = "") -> Response:
        """The page. It refers to its files by their version, so it is always requested again."""
        return etag_response(_read().page.encode(), "text/html; charset=utf-8", _HEADERS, if_none_match)

    @router.get("/static/{version}/{name:path}")
    def page_file(
        version: Annotated[str, InPath(max_length=64)],
        name: Annotated[str, InPath(max_length=100)],
        if_none_match: IfNoneMatch = "",
    ) -> Response:
        """A file of the page. With an older version in the address, the answer is the present file, which isn't cached."""
        read = _read()
        if name not in read.files:
            raise Problem(404, "no_such_address", f"the page has no file {name!r}")
        cached = {"Cache-Control": _FOR_GOOD} if version == read.version else {}
        media_type = _TYPES[Path(name).suffix]
        headers = {"X-Content-Type-Options": "nosniff", **cached}
        return etag_response(read.files[name], media_type, headers, if_none_match)

    @router.get("/docs")
    def documentation(request: Request) -> Response:
        """Swagger UI for /openapi.json; below a proxy's path, if there is one."""
        root_path = request.scope.get("root_path", "")
        answer = get_swagger_ui_html(
            openapi_url=f"{root_path}/openapi.json",
            title="SurveilNav: REST",
            swagger_js_url=f"{root_path}/docs/swagger-ui-bundle.js",
            swagger_css_url=f"{root_path}/docs/swagger-ui.css",
            swagger_favicon_url=f"{root_path}/docs/favicon.png",
            swagger_ui_parameters={"validatorUrl": None},  # a validator would send the document to another server
        )
        answer.headers["Content-Security-Policy"] = _SWAGGER_POLICY
        return answer

    @router.get("/docs/{name}")
    def documentation_file(name: Annotated[str, InPath(max_length=64)]) -> Response:
        """A file of Swagger UI."""
        if name not in _SWAGGER_TYPES:
            raise Problem(404, "no_such_address", f"/docs has no file {name[:64]!r}")
        headers = {"Cache-Control": "max-age=86400"}
        return Response((_SWAGGER / name).read_bytes(), media_type=_SWAGGER_TYPES[name], headers=headers)

    return router
