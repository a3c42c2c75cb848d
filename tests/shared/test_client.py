"""The client: every address has its call, every failure is told, a stream that breaks is gone on with."""

from __future__ import annotations

import inspect
import io
import os
import re
from pathlib import Path
from unittest.mock import MagicMock

import httpx
import numpy as np
import pytest

from surveilnav.cli import client_resources
from surveilnav.client import Client, events
from surveilnav.errors import GatewayError
from surveilnav.services.gateway.app import create_app

ROOT = Path(__file__).parents[2]
IDS = {
    "id": "x1",
    "floor": "x1",
    "layer": "value",
    "view": 3,
    "target": "tv",
    "number": 3,
    "of": ["x1/3"],
    "path": Path(os.devnull),
}


def client_of(answer) -> Client:
    return Client("http://gateway/", transport=httpx.MockTransport(answer))


def test_every_address_has_a_call_and_every_call_an_address():
    asked: set[tuple[str, str]] = set()
    npy = io.BytesIO()
    np.save(npy, np.zeros((2, 2)))

    def answer(request: httpx.Request) -> httpx.Response:
        asked.add((request.method, request.url.path))
        if request.url.path.endswith(("events", "live", "tiles")):
            return httpx.Response(200, text="id: e-1\nevent: reset\ndata: {}\n\n")
        if request.url.path.endswith(".npy"):
            return httpx.Response(200, content=npy.getvalue())
        return httpx.Response(200, json={"items": [], "total": 0, "status": "ok"})

    client = client_of(answer)
    for name, call in inspect.getmembers(client, inspect.ismethod):
        if name.startswith("_") or name == "close":
            continue
        needed = [p.name for p in inspect.signature(call).parameters.values() if p.default is p.empty]
        ids = IDS | ({"id": 7} if name == "object" else {})
        found = call(**{parameter: ids[parameter] for parameter in needed})
        if name in ("events", "live", "tiles"):
            next(found)
    paths = create_app(MagicMock(), None).openapi()["paths"]
    there = {(method.upper(), re.sub(r"\{\w+\}", "*", path)) for path, methods in paths.items() for method in methods}
    plain = {(m, re.sub(r"/(x1|7|3|value)(?=[/.]|$)", "/*", path)) for m, path in asked}
    assert plain == there


def test_the_resources_are_generated():
    written = (ROOT / "shared/surveilnav/client/resources.py").read_text(encoding="utf-8")
    assert written == client_resources.source(), "run: make docs"


@pytest.mark.parametrize(
    ("answer", "name", "words"),
    [
        (
            httpx.Response(409, json={"type": "urn:surveilnav:problem:robot_busy", "detail": "r1 is busy"}),
            "robot_busy",
            "r1",
        ),
        (httpx.Response(502, json={"title": "Bad gateway"}), "502", "Bad gateway"),
        (httpx.Response(500, json=[]), "500", "Internal Server Error"),
        (httpx.Response(404, text="<html>"), "no_gateway", "isn't a SurveilNav gateway"),
        (httpx.Response(200, text="<html>"), "no_gateway", "isn't a SurveilNav gateway"),
        (httpx.ConnectError("refused"), "no_gateway", "surveilnav up"),
        (httpx.ReadTimeout("late"), "no_gateway", "late"),
    ],
)
def test_failures_are_named_and_say_what_to_do(answer, name, words):
    def answers(request: httpx.Request) -> httpx.Response:
        if isinstance(answer, Exception):
            raise answer
        return answer

    with pytest.raises(GatewayError, match=re.escape(words)) as failed:
        client_of(answers).submit("tv")
    assert failed.value.name == name


@pytest.mark.parametrize("url", ["http://[", "", "gateway:x", "ftp://gateway"])
def test_what_is_no_address_is_a_gateway_that_doesnt_answer(url):
    with pytest.raises(GatewayError, match="no gateway answers"):
        Client(url).missions()


def test_ids_cant_leave_their_place_in_an_address():
    seen = []

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(request.url.raw_path)
        return httpx.Response(200, json={})

    client_of(answer).mission("../cameras?x=1#y")
    assert seen == [b"/api/v1/missions/..%2Fcameras%3Fx%3D1%23y"]


@pytest.fixture
def at_once(monkeypatch):
    monkeypatch.setattr(events, "_AGAIN_S", 0.0)


def test_a_stream_that_breaks_is_gone_on_with(at_once):
    """What was cut off in the middle of an event comes again, whole."""
    sent = [
        "retry: 1000\nid: e-5\nevent: reset\ndata: {}\n\nid: e-6\nevent: mission\nda",
        ': a comment\nid: e-6\nevent: mission\ndata: {"id": "m"}\n\nid: e-7\n\n',
        httpx.ReadError("cut"),
        'id: e-8\nevent: robot\ndata: {"id": "r"}\n\n',
    ]
    asked = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.headers.get("last-event-id"))
        part = sent[len(asked) - 1]
        if isinstance(part, Exception):
            raise part
        return httpx.Response(200, text=part)

    stream = client_of(answer).events()
    told = [next(stream) for _ in range(3)]
    assert [(t.id, t.kind) for t in told] == [("e-5", "reset"), ("e-6", "mission"), ("e-8", "robot")]
    assert asked == [None, "e-5", "e-7", "e-7"]
    assert told[1].data == {"id": "m"}


def test_a_stream_that_is_refused_or_never_had_is_told(at_once):
    refused = httpx.Response(503, json={"type": "urn:surveilnav:problem:too_many_streams", "detail": "later"})
    with pytest.raises(GatewayError, match="later"):
        next(client_of(lambda _: refused).events("e-1"))

    def nobody(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused")

    with pytest.raises(GatewayError, match="no gateway answers"):
        next(client_of(nobody).events())
