"""``/``: the page, and the files that it is made of. It needs nothing from elsewhere."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Response
from fastapi import Path as InPath

from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.routes.conditional import IfNoneMatch, answer

_FOLDER = Path(__file__).parents[1] / "static"
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
#: Scripts and styles are files of ours; nothing on the page, and nothing that it is told, becomes one.
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
#: Modules that are loaded when somebody opens what they show.
_LATER = "page/cloud/"
_FOR_GOOD = "max-age=31536000, immutable"


@dataclass(frozen=True, slots=True)
class _Files:
    """The page and its files, read once. ``version``: a digest of all; an address that has it never changes."""

    page: str
    files: dict[str, bytes]
    version: str


@cache
def _read() -> _Files:
    paths = [p for p in sorted(_FOLDER.rglob("*")) if p.suffix in _TYPES]
    files = {p.relative_to(_FOLDER).as_posix(): p.read_bytes() for p in paths}
    version = hashlib.sha256(b"".join(n.encode() + b"\0" + data for n, data in files.items())).hexdigest()[:16]
    at_once = [n for n in files if n.endswith(".js") and not n.startswith(_LATER)]
    preloads = "\n".join(f'<link rel="modulepreload" href="static/{version}/{name}">' for name in at_once)
    text = (_FOLDER / "page.html").read_text(encoding="utf-8")
    return _Files(text.replace("{{version}}", version).replace("{{preloads}}", preloads), files, version)


def router() -> APIRouter:
    """The page and its files."""
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    def page(if_none_match: IfNoneMatch = "") -> Response:
        """The page names its files by their version: a new gateway has a new page."""
        return answer(_read().page.encode(), "text/html; charset=utf-8", _HEADERS, if_none_match)

    @router.get("/static/{version}/{name:path}")
    def file(
        version: Annotated[str, InPath(max_length=64)],
        name: Annotated[str, InPath(max_length=100)],
        if_none_match: IfNoneMatch = "",
    ) -> Response:
        """A file of the page. A page that was opened before the gateway changed gets today's."""
        found = _read()
        if name not in found.files:
            raise Problem(404, "no_such_address", f"the page has no file {name!r}")
        cached = {"Cache-Control": _FOR_GOOD} if version == found.version else {}
        media_type = _TYPES[Path(name).suffix]
        return answer(found.files[name], media_type, {"X-Content-Type-Options": "nosniff", **cached}, if_none_match)

    return router
