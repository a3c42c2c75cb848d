"""A gateway without its services, without its router, without its port: it says what is missing and what to do."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.router import free_port, open_router
from tests.waiting import until

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def lonely(router, start_gateway):
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack)
        yield stack.enter_context(httpx.Client(base_url=url, timeout=20))


def test_it_lives_but_isnt_ready(lonely):
    assert lonely.get("/healthz").status_code == 200
    answer = lonely.get("/readyz")
    assert answer.status_code == 503
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["missing"] == ["robot", "perception", "fusion", "planner"]
    assert "python -m surveilnav.services.planner" in answer.json()["checks"]["planner"]


@pytest.mark.parametrize(
    "path", ["missions/m-1", "missions/m-1/plan", "objects", "objects?floor=0", "floors/0/layers/explored.png"]
)
def test_what_nobody_can_answer_is_503(lonely, path):
    answer = lonely.get(f"/api/v1/{path}")
    assert (answer.status_code, answer.json()["type"]) == (503, "urn:surveilnav:problem:absent")


def test_a_mission_without_a_planner_is_503(lonely):
    answer = lonely.post("/api/v1/missions", json={"target": "tv"})
    assert answer.status_code == 503
    assert "surveilnav.services.planner" in answer.json()["detail"]
    for what in ("cancel", "pause", "resume"):
        assert lonely.post(f"/api/v1/missions/m-1/{what}").status_code == 503
    assert lonely.post("/api/v1/robots/stop").status_code == 503


@pytest.mark.parametrize("name", ["missions", "cameras", "robots", "floors", "perception"])
def test_lists_are_empty(lonely, name):
    assert {"items": [], "total": 0}.items() <= lonely.get(f"/api/v1/{name}").json().items()


def test_values_need_a_target_while_there_is_no_mission(lonely):
    assert lonely.get("/api/v1/floors/0/layers/value.png").status_code == 422


def test_readiness_follows_who_is_there(lonely, router):
    def missing() -> list[str]:
        return list(lonely.get("/readyz").json()["missing"])

    with Node("perception", "w1", BusSettings(router=router)):
        until(lambda: "perception" not in missing(), "the worker was never noticed")
        assert missing() == ["robot", "fusion", "planner"]
    until(lambda: "perception" in missing(), "the worker is gone but still counted")


def test_a_router_that_dies_is_missing_and_comes_back(start_gateway):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        router = open_router(endpoint)
        url, _ = start_gateway(endpoint, stack)
        assert "router" not in httpx.get(f"{url}/readyz").json()["missing"]
        router.close()
        until(lambda: "router" in httpx.get(f"{url}/readyz").json()["missing"], "the router is gone but counted")
        assert httpx.get(f"{url}/healthz").status_code == 200
        assert httpx.post(f"{url}/api/v1/missions", json={"target": "tv"}).status_code == 503
        stack.enter_context(open_router(endpoint))
        until(lambda: "router" not in httpx.get(f"{url}/readyz").json()["missing"], "it never came back", timeout_s=10)


# --- the process --------------------------------------------------------------------------------------------------


def start(**environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "surveilnav.services.gateway"],
        cwd=ROOT,
        env={**os.environ, **environment},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def fails(process: subprocess.Popen[str]) -> str:
    """The one line that a process which can't start leaves behind."""
    out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert out == ""
    assert "Traceback" not in err
    assert err.count("\n") == 1, err
    return err


def test_a_taken_port_is_one_line_that_says_what_to_do(router):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        err = fails(start(SURVEILNAV_GATEWAY__PORT=port, SURVEILNAV_BUS__ROUTER=router))
    assert port in err
    assert "SURVEILNAV_GATEWAY__PORT" in err


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"SURVEILNAV_GATEWAY__PORT": "eighty"}, "port"),
        (
            {
                "SURVEILNAV_GATEWAY__PORT": "0",
                "SURVEILNAV_BUS__ROUTER": "tcp/127.0.0.1:1",
                "SURVEILNAV_BUS__CONNECT_TIMEOUT_S": "0.2",
            },
            "no router answers",
        ),
        ({"SURVEILNAV_GATEWAY__HOST": "no.such.host.invalid", "SURVEILNAV_GATEWAY__PORT": "0"}, "can't listen"),
    ],
)
def test_a_wrong_setting_is_one_line(environment, words):
    assert words in fails(start(**environment))


def test_the_process_serves_and_stops_at_sigterm(router):
    port = str(free_port())
    process = start(SURVEILNAV_GATEWAY__PORT=port, SURVEILNAV_BUS__ROUTER=router)

    def answers() -> bool:
        try:
            return httpx.get(f"http://127.0.0.1:{port}/healthz").status_code == 200
        except httpx.TransportError:
            assert process.poll() is None
            return False

    try:
        until(answers, "it never served", timeout_s=30)
        with httpx.stream("GET", f"http://127.0.0.1:{port}/api/v1/events") as stream:
            chunks = stream.iter_text()
            next(chunks)
            process.send_signal(signal.SIGTERM)
            assert "".join(chunks) == "", "an open stream ends, and at the end of an event"
        _, err = process.communicate(timeout=20)
        assert process.returncode == 0, err
        assert "Traceback" not in err
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()
