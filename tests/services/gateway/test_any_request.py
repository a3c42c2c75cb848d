"""Whatever is asked of any address: no 5xx of our own making, every failure a problem, every answer as the OpenAPI document says.

Requests are made from the document itself, so a new address is tested as soon as it is there.
"""

from __future__ import annotations

import functools
import json
import re
from typing import Any
from unittest.mock import MagicMock
from urllib.parse import quote

import httpx
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from services.gateway.app import create_app
from surveilnav.bus import clock_ns
from surveilnav.messages import MissionStatus

API = create_app(MagicMock(), None).openapi()
#: These never end: their own tests read them.
STREAMS = ("/api/v1/events", "/api/v1/live", "/api/v1/tiles")
OPERATIONS = [
    (method.upper(), path) for path, methods in API["paths"].items() for method in methods if path not in STREAMS
]
#: Ids that are there, beside whatever else comes.
THERE = ["c1", "r1", "0", "m-there", "occupancy", "value", "3"]
TEXT = st.one_of(st.sampled_from(THERE), st.text(max_size=40), st.text("a%./*{}\\?#&;=\0\n ", max_size=12))
NUMBER = st.one_of(st.integers(-2, 20), st.integers(-(2**70), 2**70), st.floats(), st.just("1e999"))
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=20)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=10), inner, max_size=4)),
    max_leaves=10,
)  # fmt: skip


@functools.cache
def validator(name: str) -> Draft202012Validator:
    return Draft202012Validator({**schema_at(name), "components": API["components"]})


def schema_at(place: str) -> Any:
    found: Any = API
    for step in place.split("\t"):
        found = found[step]
    return found


def value_for(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Mostly what a parameter may be, and what it may not."""
    kinds = [s.get("type") for s in schema.get("anyOf", [schema])]
    if "integer" in kinds or "number" in kinds:
        return st.one_of(NUMBER, TEXT)
    enum = [v for s in schema.get("anyOf", [schema]) for v in s.get("enum", [])]
    return st.one_of(st.sampled_from(enum), TEXT) if enum else TEXT


@st.composite
def requests(draw: st.DrawFn, method: str, path: str) -> httpx.Request:
    operation = API["paths"][path][method.lower()]
    where, query, headers = path, [], {}
    for parameter in operation.get("parameters", []):
        if parameter["in"] != "path" and not draw(st.booleans()):
            continue
        value = str(draw(value_for(parameter["schema"])))
        if parameter["in"] == "path":
            where = where.replace("{" + parameter["name"] + "}", quote(value, safe=""))
        elif parameter["in"] == "query":
            query.append(f"{parameter['name']}={quote(value, safe='')}")
        else:
            headers[parameter["name"]] = re.sub(r"[^\x21-\x7e]", "?", value) or "x"
    content = None
    if "requestBody" in operation and draw(st.booleans()):
        body = draw(st.one_of(JSON, bodies()))
        content = draw(st.one_of(st.just(json.dumps(body).encode()), st.binary(max_size=30)))
        headers["content-type"] = draw(st.sampled_from(["application/json", "text/plain", "application/octet-stream"]))
    url = "http://gateway" + where + ("?" + "&".join(query) if query else "")
    return httpx.Request(method, url, headers=headers, content=content)


def bodies() -> st.SearchStrategy[dict[str, Any]]:
    """What looks like a goal or a reason."""
    field = st.one_of(JSON, TEXT)
    names = st.sampled_from(["target", "robot", "max_steps", "queue", "reason", "other"])
    return st.dictionaries(names, field, max_size=6)


def is_ours(problem: dict[str, Any]) -> bool:
    """Whether a 5xx is the gateway's own fault, and not that of a fake that was asked for it."""
    return str(problem["type"]).rpartition(":")[2] not in ("bad_picture",)


def check(method: str, path: str, answer: httpx.Response) -> None:
    operation = API["paths"][path][method.lower()]
    kind = answer.headers.get("content-type", "").partition(";")[0]
    if answer.is_error:
        assert kind == "application/problem+json", answer.text
        problem = answer.json()
        schema = operation["responses"]["default"]["content"]["application/problem+json"]["schema"]
        Draft202012Validator(schema).validate(problem)
        assert problem["status"] == answer.status_code
        assert answer.status_code < 500 or not is_ours(problem), problem
        return
    declared = operation["responses"][str(answer.status_code)]
    if not answer.content:
        assert answer.status_code in (204, 304)
        return
    assert kind in declared["content"], (kind, list(declared["content"]))
    if kind == "application/json":
        validator(
            "\t".join(("paths", path, method.lower(), "responses", str(answer.status_code), "content", kind, "schema"))
        ).validate(answer.json())


@pytest.mark.parametrize(("method", "path"), OPERATIONS, ids=[f"{m} {p}" for m, p in OPERATIONS])
def test_any_request_is_answered_as_documented(client, building, method, path):
    if "m-there" not in building.missions:
        building.put_status(
            MissionStatus(
                stamp_ns=clock_ns(), mission="m-there", target="tv", robot="r1", state="active", phase="exploring", step=1,
                max_steps=9, path_m=1.0,
            )
        )  # fmt: skip

    @settings(
        max_examples=20, deadline=None, derandomize=True, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(requests(method, path))
    def ask(request: httpx.Request) -> None:
        here = httpx.Request(
            method,
            client.base_url.join(request.url.raw_path.decode()),
            headers=request.headers,
            content=request.content,
        )
        here.headers["host"] = client.base_url.netloc.decode()
        check(method, path, client.send(here))

    ask()


def test_the_check_finds_what_doesnt_fit():
    fits = {
        "id": "b",
        "floors": [],
        "cameras": 0,
        "robots": 0,
        "missions": 0,
        "ready": True,
        "stale": False,
        "last_seen": None,
    }
    path = "/api/v1/buildings"
    check("GET", path, httpx.Response(200, json={"items": [fits], "total": 1}))
    for wrong in ({**fits, "cameras": "many"}, {k: v for k, v in fits.items() if k != "stale"}):
        with pytest.raises(Exception, match=r"is not of type|required property"):
            check("GET", path, httpx.Response(200, json={"items": [wrong], "total": 1}))
    with pytest.raises(AssertionError):
        check("GET", path, httpx.Response(500, text="boom"))
