"""Behind a proxy that has the gateway below a path, and takes that off."""

from __future__ import annotations

import re
from contextlib import ExitStack

import httpx
import pytest

from surveilnav.services.gateway.config import GatewaySettings
from tests.waiting import until


@pytest.fixture(scope="module")
def proxied(router, building, start_gateway):
    """Asks as the proxy does: without the path."""
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack, "/surveilnav")
        client = stack.enter_context(httpx.Client(base_url=url, timeout=20))
        until(lambda: client.get("/api/v1/cameras").json()["total"])
        yield client


def behind(address: str) -> str:
    """The address that the proxy asks for."""
    assert address.startswith("/surveilnav/")
    return address.removeprefix("/surveilnav")


def test_addresses_in_answers_begin_where_the_proxy_has_the_gateway(proxied):
    camera = proxied.get("/api/v1/cameras/c1").json()
    assert proxied.get(behind(camera["views"][0]["picture"])).status_code == 200
    building_floor = proxied.get("/api/v1/floors").json()["items"][0]
    assert proxied.get(behind(building_floor["layers"]["explored"])).status_code == 200
    layer = proxied.get("/api/v1/floors/0/layers/explored").json()
    assert proxied.get(behind(layer["array"])).status_code == 200
    answer = proxied.post("/api/v1/missions", json={"target": "tv"})
    assert proxied.get(behind(answer.headers["location"])).status_code == 200


def test_the_pages_find_what_they_need(proxied):
    assert proxied.get("/openapi.json").json()["servers"] == [{"url": "/surveilnav"}]
    links = re.findall(r'(?:src|href)="([^"]+)"', proxied.get("/docs").text)
    assert len(links) == 3
    assert all(proxied.get(behind(link)).status_code == 200 for link in links)
    page = proxied.get("/").text
    assert not re.findall(r'(?:src|href)="/', page), "the page's own addresses are relative"
    for name in re.findall(r'"(static/[^"]+\.js)"', page):
        assert not re.findall(r"""["'`]/(?:api|readyz|static)""", proxied.get(f"/{name}").text), name


def test_what_a_proxy_says_of_others_isnt_believed(proxied):
    said = {"X-Forwarded-Host": "rebound.example", "X-Forwarded-For": "10.0.0.1", "X-Forwarded-Proto": "https"}
    assert proxied.get("/healthz", headers=said).status_code == 200
    answer = proxied.get("/healthz", headers={"Host": "rebound.example", "X-Forwarded-Host": "localhost"})
    assert answer.status_code == 421


@pytest.mark.parametrize("path", ["surveilnav", "/surveilnav/", "/a b", "//a", "http://a/", "/a?b"])
def test_a_root_path_that_is_none_is_refused(monkeypatch, path):
    monkeypatch.setenv("SURVEILNAV_GATEWAY__ROOT_PATH", path)
    with pytest.raises(ValueError, match="root_path"):
        GatewaySettings()
