"""The client: every address has its call, every failure is told, a stream that breaks goes on."""

from __future__ import annotations

import inspect
import io
import os
import re
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import httpx
import numpy as np
import pytest

from surveilnav import rest
from surveilnav.client import Client, events
from surveilnav.errors import GatewayError
from surveilnav.rest import examples
from surveilnav.services.gateway.app import create_app

IDS = {
    "id": "x1",
    "floor": "x1",
    "layer": "value",
    "view": 3,
    "target": "tv",
    "number": 3,
    "of": ["x1/3"],
    "source": "camera/x1",
    "path": Path(os.devnull),
}


def client_of(answer) -> Client:
    return Client("http://gateway/", transport=httpx.MockTransport(answer))


def npy() -> bytes:
    file = io.BytesIO()
    np.save(file, np.zeros((2, 2)))
    return file.getvalue()


def made_up(schema: dict[str, Any]) -> Any:
    """A value that fits a schema of the OpenAPI document."""
    if "$ref" in schema:
        return made_up(SCHEMAS[schema["$ref"].rpartition("/")[2]])
    if "anyOf" in schema:
        return made_up(schema["anyOf"][0])
    if "enum" in schema:
        return schema["enum"][0]
    if "prefixItems" in schema:
        return [made_up(item) for item in schema["prefixItems"]]
    if schema.get("type") == "object":
        return {name: made_up(field) for name, field in schema.get("properties", {}).items()}
    if schema.get("format") == "date-time":
        return "2026-01-31T10:00:41Z"
    if schema.get("type") == "array":
        return [made_up(schema["items"])] * schema.get("minItems", 1)
    return {"string": "ok", "integer": 1, "number": 0.5, "boolean": True}[schema["type"]]


API: dict[str, Any] = create_app(MagicMock(), None).openapi()
SCHEMAS = API["components"]["schemas"]


def addressed(request: httpx.Request) -> tuple[str, str]:
    """Method and path as the OpenAPI document has them, with * for parameters."""
    return request.method, re.sub(r"/(x1|7|3|value)(?=[/.]|$)", "/*", request.url.path)


def test_every_address_has_a_call_that_returns_its_resource_and_every_call_an_address():
    """The gateway's answers are made up from the OpenAPI document; the client must find in them what its calls promise."""
    described = {
        (method.upper(), re.sub(r"\{\w+\}", "*", path)): operation
        for path, methods in API["paths"].items()
        for method, operation in methods.items()
    }
    asked: set[tuple[str, str]] = set()
    answered: dict[str, Any] = {}

    def answer(request: httpx.Request) -> httpx.Response:
        asked.add(addressed(request))
        if request.url.path.endswith(("events", "live", "tiles")):
            return sse("id: e-1\nevent: reset\ndata: {}\n\n")
        if request.url.path.endswith(".npy"):
            return httpx.Response(200, content=npy())
        responses = described[addressed(request)]["responses"]
        status = next(s for s in responses if s.startswith("2"))
        schema = responses[status].get("content", {}).get("application/json", {}).get("schema")
        if schema is None:
            return httpx.Response(int(status), content=b"")
        answered["schema"] = str(schema.get("$ref", "")).rpartition("/")[2]
        value = {"status": "ok"} if request.url.path == "/healthz" else made_up(schema)
        return httpx.Response(int(status), json=value)

    client = client_of(answer)
    for name, call in inspect.getmembers(client, inspect.ismethod):
        if name.startswith("_") or name == "close":
            continue
        needed = [p.name for p in inspect.signature(call).parameters.values() if p.default is p.empty]
        ids = IDS | ({"id": 7} if name == "object" else {})
        answered.clear()
        found = call(**{parameter: ids[parameter] for parameter in needed})
        if name in ("events", "live", "tiles"):
            next(found)
        elif model := answered.get("schema"):
            one = found[0] if isinstance(found, list) else found
            assert model in (type(one).__name__, f"Items_{type(one).__name__}_", f"GrowingItems_{type(one).__name__}_")
            assert type(one) is getattr(rest, type(one).__name__), "the one definition"
    # sessions are for pages: programs send their key
    sessions = {(method, "/api/v1/session") for method in ("GET", "POST", "DELETE")}
    assert asked == set(described) - sessions


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
        return httpx.Response(200, json=examples.MISSION)

    client_of(answer).mission("../cameras?x=1#y")
    assert seen == [b"/api/v1/missions/..%2Fcameras%3Fx%3D1%23y"]


def test_an_answer_without_the_fields_of_a_resource_is_told():
    client = client_of(lambda _: httpx.Response(200, json={"id": "m"}))
    with pytest.raises(GatewayError, match=r"expected Mission from .*missions/m.*(target|stale).*version") as failed:
        client.mission("m")
    assert failed.value.name == "bad_answer"
    stream = client_of(lambda _: sse('id: e-1\nevent: mission\ndata: {"step": "many"}\n\n')).events()
    with pytest.raises(GatewayError, match=r"an event \(mission\).*step") as failed:
        next(stream)
    assert failed.value.name == "bad_answer"


@pytest.fixture
def at_once(monkeypatch):
    monkeypatch.setattr(events, "_RECONNECT_S", 0.0)


def sse(text: str) -> httpx.Response:
    return httpx.Response(200, text=text, headers={"content-type": "text/event-stream; charset=utf-8"})


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
        return sse(part)

    stream = client_of(answer).events()
    told = [next(stream) for _ in range(3)]
    assert [(t.id, t.kind) for t in told] == [("e-5", "reset"), ("e-6", "mission"), ("e-8", "robot")]
    assert asked == [None, "e-5", "e-7", "e-7"]
    assert told[1].data.id == "m"


def test_a_connection_that_breaks_before_its_first_event_loses_no_place(at_once):
    sent = ['id: e-5\nevent: mission\ndata: {"id": "m"}\n\n', "retry: 1000\n\n", "id: e-6\nevent: robot\ndata: {}\n\n"]
    asked = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.headers.get("last-event-id"))
        return sse(sent[len(asked) - 1])

    stream = client_of(answer).events()
    assert [next(stream).id for _ in range(2)] == ["e-5", "e-6"]
    assert asked == [None, "e-5", "e-5"]


def test_what_answers_without_events_is_no_gateway(at_once):
    with pytest.raises(GatewayError, match=r"no gateway answers.*text/event-stream"):
        next(client_of(lambda _: httpx.Response(200, text="<html>")).events())


def test_a_stream_that_is_refused_or_never_had_is_told(at_once):
    refused = httpx.Response(503, json={"type": "urn:surveilnav:problem:too_many_streams", "detail": "later"})
    with pytest.raises(GatewayError, match="later"):
        next(client_of(lambda _: refused).events("e-1"))

    def nobody(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused")

    with pytest.raises(GatewayError, match="no gateway answers"):
        next(client_of(nobody).events())
