"""Each route has a role, and a request needs the role of its route."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest
from fastapi.routing import APIRoute

from surveilnav.rest import ROOT
from surveilnav.security.roles import Role
from surveilnav.services.gateway.app import create_app
from surveilnav.services.gateway.roles import ROLES, needed_role


def routes() -> set[tuple[str, str]]:
    """Every method and address of the application, hidden ones among them."""
    found = set()
    for route in create_app(MagicMock(), None).routes:
        inner = route.effective_candidates() if hasattr(route, "effective_candidates") else [route]
        for one in inner:
            assert isinstance(getattr(one, "original_route", one), APIRoute) or one.path == "/openapi.json", one
            found |= {(method, one.path) for method in one.methods if method != "HEAD"}
    return found


def test_every_route_has_a_role_and_every_role_a_route():
    assert len(routes()) > 40
    assert routes() == set(ROLES), "a new address gets a row in services/gateway/roles.py"


@pytest.mark.parametrize(
    ("method", "path", "role"),
    [
        ("GET", "/", None),
        ("GET", "/healthz", None),
        ("GET", "/static/abc/page/main.js", None),
        ("GET", f"{ROOT}/session", None),
        ("GET", f"{ROOT}/cameras/c1/latest.jpg", Role.viewer),
        ("HEAD", f"{ROOT}/cameras/c1/latest.jpg", Role.viewer),
        ("GET", f"{ROOT}/cameras/c1/looks", Role.admin),
        ("GET", "/metrics", Role.viewer),
        ("GET", "/openapi.json", Role.viewer),
        ("POST", f"{ROOT}/missions", Role.operator),
        ("POST", f"{ROOT}/robots/stop", Role.operator),
        ("DELETE", f"{ROOT}/cameras/c1", Role.admin),
        ("DELETE", f"{ROOT}/pictures", Role.admin),
        ("DELETE", f"{ROOT}/recordings/r1", Role.admin),
        # what isn't there is for admins: whoever adds it has decided nothing yet
        ("GET", f"{ROOT}/secrets", Role.admin),
        ("PUT", f"{ROOT}/missions", Role.admin),
        ("OPTIONS", f"{ROOT}/missions", Role.admin),
        ("GET", "/healthz/", Role.admin),
        ("GET", "//healthz", Role.admin),
    ],
)
def test_who_may_ask(method, path, role):
    assert needed_role(method, path) == role


def test_asking_is_for_viewers_and_changing_isnt():
    for (method, _), role in ROLES.items():
        if method != "GET" and role is not None:
            assert role >= Role.operator
        if method == "DELETE" and role is not None:
            assert role is Role.admin
