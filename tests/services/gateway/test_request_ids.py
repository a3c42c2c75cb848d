"""The id that each HTTP request gets: taken from its headers or made, and answered."""

from __future__ import annotations

import re

import pytest

from surveilnav.messages import FINISHED_STATES

TRACE = "0af7651916cd43dd8448eb211c80319c"
TRACEPARENT = f"00-{TRACE}-b7ad6b7169203331-01"
MADE = re.compile(r"[0-9a-f]{32}")


def answered(client, *headers: tuple[str, str]) -> str:
    answer = client.get("/api/v1/missions", headers=list(headers))
    assert answer.status_code == 200
    return answer.headers["x-request-id"]


def test_an_id_is_taken_from_the_request_or_made(client):
    assert answered(client, ("X-Request-ID", "Order_7.a-b")) == "Order_7.a-b"
    assert answered(client, ("traceparent", TRACEPARENT)) == TRACE
    assert answered(client, ("X-Request-ID", "mine"), ("traceparent", TRACEPARENT)) == "mine"
    first, second = answered(client), answered(client)
    assert MADE.fullmatch(first)
    assert MADE.fullmatch(second)
    assert first != second


@pytest.mark.parametrize(
    "headers",
    [
        [("X-Request-ID", "")],
        [("X-Request-ID", "a" * 65)],
        [("X-Request-ID", "a b")],
        [("X-Request-ID", "$(reboot)")],
        [("X-Request-ID", "x\u00e9")],
        [("X-Request-ID", "\u001b[31mred")],
        [("X-Request-ID", "one"), ("X-Request-ID", "two")],
        [("traceparent", f"00-{'0' * 32}-b7ad6b7169203331-01")],
        [("traceparent", f"00-{TRACE}-{'0' * 16}-01")],
        [("traceparent", f"ff-{TRACE}-b7ad6b7169203331-01")],
        [("traceparent", TRACEPARENT.upper())],
        [("traceparent", TRACEPARENT + "-" + "x" * 500)],
        [("traceparent", TRACE)],
    ],
)
def test_what_is_no_id_is_passed_over(client, headers):
    raw = [(name.encode(), value.encode("latin-1")) for name, value in headers]
    answer = client.get("/api/v1/missions", headers=raw)
    assert answer.status_code == 200
    assert MADE.fullmatch(answer.headers["x-request-id"])


def test_refusals_have_an_id_too(client):
    assert client.get("/nowhere", headers={"X-Request-ID": "lost"}).headers["x-request-id"] == "lost"
    foreign = client.get("/api/v1/missions", headers={"Host": "evil.example", "X-Request-ID": "foreign"})
    assert (foreign.status_code, foreign.headers["x-request-id"]) == (421, "foreign")


def test_a_mission_has_the_id_of_the_request_that_began_it(client):
    answer = client.post("/api/v1/missions", json={"target": "tv"}, headers={"X-Request-ID": "order-7"})
    assert answer.status_code == 202
    assert answer.json()["state"] not in FINISHED_STATES
    assert answer.json()["request_id"] == answer.headers["x-request-id"] == "order-7"
