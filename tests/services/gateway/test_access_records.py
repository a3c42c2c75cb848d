"""Who was shown which camera, over REST: every picture that goes out is recorded, nothing else is."""

from __future__ import annotations

from contextlib import ExitStack

import httpx
import pytest

from surveilnav.bus import Node
from surveilnav.client import Client
from surveilnav.errors import GatewayError
from tests.waiting import until


@pytest.fixture
def client(router, building, start_gateway):
    """A gateway whose log is empty."""
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack)
        client = stack.enter_context(httpx.Client(base_url=url, timeout=20))
        building.put_sources()
        until(lambda: client.get("/api/v1/cameras").json()["total"])
        yield client


def records(client):
    return [(k["view"], k["what"], k["client"]) for k in client.get("/api/v1/cameras/c1/looks").json()["items"]]


def test_pictures_are_recorded_and_nothing_else(client):
    for address in ("cameras", "cameras/c1", "cameras/c1/cones", "floors/0/layers/explored.png"):
        client.get(f"/api/v1/{address}")
    assert client.get("/api/v1/cameras/c1/views/99.jpg").status_code == 404
    assert client.get("/api/v1/cameras/c1/views/11.jpg").status_code == 502, "no picture went out"
    assert client.get("/api/v1/cameras/nobody/latest.jpg").status_code == 404
    assert records(client) == []
    assert client.get("/api/v1/cameras/c1/views/3.jpg").status_code == 200
    latest = client.get("/api/v1/cameras/c1/latest.jpg")
    assert records(client) == [(0, "latest", "127.0.0.1"), (3, "thumbnail", "127.0.0.1")]
    again = client.get("/api/v1/cameras/c1/latest.jpg?view=4", headers={"If-None-Match": "*"})
    assert again.status_code == 304
    assert records(client)[0] == (4, "latest", "127.0.0.1"), "who has it already looks at it all the same"
    assert latest.headers["etag"]


def test_tiles_are_recorded_for_the_views_whose_pictures_went_out(client):
    with client.stream("GET", "/api/v1/tiles?of=c1/3&of=c1/11&of=nobody/0") as answer:
        next(line for line in answer.iter_lines() if '"jpeg"' in line)
    assert records(client) == [(3, "tile", "127.0.0.1")]


def test_what_a_client_says_of_itself_isnt_believed(client):
    client.get("/api/v1/cameras/c1/views/5.jpg", headers={"X-Forwarded-For": "1.2.3.4"})
    assert records(client) == [(5, "thumbnail", "127.0.0.1")]


def test_no_picture_is_in_the_log_and_lists_have_pages(client):
    for view in range(5):
        client.get(f"/api/v1/cameras/c1/views/{view}.jpg")
    page = client.get("/api/v1/cameras/c1/looks?limit=2&offset=1").json()
    assert (page["total"], [k["view"] for k in page["items"]]) == (5, [3, 2])
    assert set(page["items"][0]) == {"time", "client", "key", "view", "what"}
    assert client.get("/api/v1/cameras/nobody/looks").json() == {"items": [], "total": 0}
    with Client(str(client.base_url)) as program:
        assert [k.view for k in program.access_records("c1")] == [4, 3, 2, 1, 0]


def test_past_pictures_are_forgotten_by_all_who_keep_any(client, building):
    client.get("/api/v1/cameras/c1/latest.jpg")
    with Client(str(client.base_url)) as program:
        said = [(k.keeper, k.message) for k in program.forget_pictures()]
        assert said == [("gateway", "1 thumbnails are gone"), ("f1", "gone within seconds")]
        with Node("fusion", "f2", building.settings), pytest.raises(GatewayError) as refused:
            until(lambda: program.forget_pictures() and None)
    assert refused.value.name == "keeper_silent"
    assert "f2" in str(refused.value)
