"""Which role each address needs. A route without a row here is for admins alone, and fails a test."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from re import Pattern

from starlette.routing import compile_path

from surveilnav.rest import ROOT
from surveilnav.security.roles import Role

#: Who needs no key: the page and its files, which show nothing of the building; signing in; and whether this process is alive.
EVERYBODY = None
_VIEWER, _OPERATOR, _ADMIN = Role.viewer, Role.operator, Role.admin

#: The least role for each method and address, as the routes are written.
ROLES: dict[tuple[str, str], Role | None] = {
    ("GET", "/"): EVERYBODY,
    ("GET", "/static/{version}/{name:path}"): EVERYBODY,
    ("GET", "/healthz"): EVERYBODY,
    ("GET", f"{ROOT}/session"): EVERYBODY,
    ("POST", f"{ROOT}/session"): EVERYBODY,
    ("DELETE", f"{ROOT}/session"): EVERYBODY,
    ("GET", "/docs"): _VIEWER,
    ("GET", "/docs/{name}"): _VIEWER,
    ("GET", "/openapi.json"): _VIEWER,
    ("GET", "/readyz"): _VIEWER,
    ("GET", "/metrics"): _VIEWER,
    ("GET", f"{ROOT}/buildings"): _VIEWER,
    ("GET", f"{ROOT}/traffic"): _VIEWER,
    ("GET", f"{ROOT}/traffic/series"): _VIEWER,
    ("GET", f"{ROOT}/traffic/series.csv"): _VIEWER,
    ("GET", f"{ROOT}/services"): _VIEWER,
    ("GET", f"{ROOT}/events"): _VIEWER,
    ("GET", f"{ROOT}/live"): _VIEWER,
    ("GET", f"{ROOT}/tiles"): _VIEWER,
    ("GET", f"{ROOT}/cameras"): _VIEWER,
    ("GET", f"{ROOT}/cameras/{{id}}"): _VIEWER,
    ("GET", f"{ROOT}/cameras/{{id}}/views/{{view}}.jpg"): _VIEWER,
    ("GET", f"{ROOT}/cameras/{{id}}/latest.jpg"): _VIEWER,
    ("GET", f"{ROOT}/cameras/{{id}}/looks"): _ADMIN,  # it names people
    ("GET", f"{ROOT}/cameras/{{id}}/cones"): _VIEWER,
    ("POST", f"{ROOT}/cameras/{{id}}/pause"): _ADMIN,
    ("POST", f"{ROOT}/cameras/{{id}}/resume"): _ADMIN,
    ("DELETE", f"{ROOT}/cameras/{{id}}"): _ADMIN,
    ("DELETE", f"{ROOT}/pictures"): _ADMIN,
    ("GET", f"{ROOT}/floors"): _VIEWER,
    ("GET", f"{ROOT}/floors/{{id}}/layers/{{layer}}.png"): _VIEWER,
    ("GET", f"{ROOT}/floors/{{id}}/layers/{{layer}}.npy"): _VIEWER,
    ("GET", f"{ROOT}/floors/{{id}}/layers/{{layer}}"): _VIEWER,
    ("GET", f"{ROOT}/floors/{{id}}/cloud.npy"): _VIEWER,
    ("GET", f"{ROOT}/floors/{{id}}/objects/{{object}}"): _VIEWER,
    ("GET", f"{ROOT}/floors/{{id}}/objects/{{object}}/history/{{number}}.jpg"): _VIEWER,
    ("GET", f"{ROOT}/areas"): _VIEWER,
    ("GET", f"{ROOT}/objects"): _VIEWER,
    ("POST", f"{ROOT}/sightings"): _OPERATOR,  # it has cameras send pictures to fusion
    ("GET", f"{ROOT}/missions"): _VIEWER,
    ("GET", f"{ROOT}/missions/{{id}}"): _VIEWER,
    ("GET", f"{ROOT}/missions/{{id}}/plan"): _VIEWER,
    ("GET", f"{ROOT}/missions/{{id}}/traffic"): _VIEWER,
    ("POST", f"{ROOT}/missions"): _OPERATOR,
    ("POST", f"{ROOT}/missions/{{id}}/cancel"): _OPERATOR,
    ("POST", f"{ROOT}/missions/{{id}}/pause"): _OPERATOR,
    ("POST", f"{ROOT}/missions/{{id}}/resume"): _OPERATOR,
    ("GET", f"{ROOT}/robots"): _VIEWER,
    ("POST", f"{ROOT}/robots/stop"): _OPERATOR,
    ("POST", f"{ROOT}/robots/release"): _OPERATOR,
    ("GET", f"{ROOT}/perception"): _VIEWER,
    ("GET", f"{ROOT}/targets"): _VIEWER,
    ("GET", f"{ROOT}/removals"): _VIEWER,
    ("GET", f"{ROOT}/removals/{{id}}"): _VIEWER,
    ("POST", f"{ROOT}/removals"): _ADMIN,
    ("GET", f"{ROOT}/recorders"): _VIEWER,
    ("GET", f"{ROOT}/recordings"): _VIEWER,
    ("GET", f"{ROOT}/recordings/{{id}}"): _VIEWER,
    ("GET", f"{ROOT}/recordings/{{id}}/file"): _VIEWER,
    ("DELETE", f"{ROOT}/recordings/{{id}}"): _ADMIN,
    ("GET", f"{ROOT}/replay"): _VIEWER,
    ("PATCH", f"{ROOT}/replay"): _OPERATOR,
}


@dataclass(frozen=True, slots=True)
class _Row:
    pattern: Pattern[str]
    role: Role | None


@cache
def _rows(method: str) -> tuple[_Row, ...]:
    return tuple(_Row(compile_path(path)[0], role) for (m, path), role in ROLES.items() if m == method)


def needed_role(method: str, path: str) -> Role | None:
    """The least role for a request; None: everybody may send it.

    Where several rows match a path, the highest role counts; where none does, only admins are answered.
    """
    found = [row.role for row in _rows("GET" if method == "HEAD" else method) if row.pattern.match(path)]
    if not found:
        return Role.admin
    return None if all(role is None for role in found) else max(role for role in found if role is not None)
