"""The whole system in containers, on a real Docker engine: three cameras in places of their own, and one mission."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.compose.stack import MISSION_S, UP_S, Stack, missing
from tests.waiting import until

#: Containers of cameras at first; then as many as there are places in the plan.
_CAMERAS, _PLACES = 3, 8
_KILLED = ("camera", "perception", "fusion", "planner")


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    stack = Stack(
        tmp_path_factory.mktemp("models"),
        SURVEILNAV_SIM__BUILDING="parametric_flat",
        SURVEILNAV_SIM__SEED="0",
        SURVEILNAV_SIM__CAMERAS=str(_PLACES),
        SURVEILNAV_PERCEPTION__BACKEND="oracle",
    )
    with stack.running("--scale", f"camera={_CAMERAS}"):
        yield stack


pytestmark = [pytest.mark.compose, pytest.mark.slow, pytest.mark.timeout(UP_S + 2 * MISSION_S)]


def test_every_container_is_healthy(stack: Stack) -> None:
    by_service: dict[str, list[dict[str, Any]]] = {}
    for container in stack.containers():
        by_service.setdefault(container["Service"], []).append(container)
    assert [c["ExitCode"] for c in by_service.pop("prepare")] == [0]
    assert {name: len(containers) for name, containers in by_service.items()} == {
        "router": 1,
        "camera": _CAMERAS,
        "robot": 1,
        "perception": 1,
        "fusion": 1,
        "planner": 1,
        "gateway": 1,
        "recorder": 1,
    }
    unhealthy = [c["Name"] for containers in by_service.values() for c in containers if c["Health"] != "healthy"]
    assert not unhealthy, stack.state()


def test_services_can_change_nothing_but_their_own_files(stack: Stack) -> None:
    for service in ("camera", "gateway"):
        said = stack.compose("exec", "-T", service, "sh", "-c", "id -u; touch /opt/x 2>/dev/null && echo written; true")
        assert said.split() == ["10001"]


@pytest.mark.parametrize("service", ["fusion", "camera"])
def test_an_image_has_nothing_to_build_or_install_with(stack: Stack, service: str) -> None:
    tools = "pip pip3 gcc cc g++ make ld git wget curl"
    said = stack.compose("exec", "-T", service, "sh", "-c", f"for t in {tools}; do command -v $t; done; echo searched")
    assert said.split() == ["searched"]
    look = "import importlib.util as u; print([n for n in ('pip', 'torch', 'open3d') if u.find_spec(n)])"
    has = stack.compose("exec", "-T", service, "python", "-c", look).strip()
    assert has == ("['open3d']" if service == "camera" else "[]")


def test_each_camera_replica_has_a_place_of_its_own(stack: Stack) -> None:
    deadline_s = time.monotonic() + 60.0
    while len(cameras := stack.get("/api/v1/cameras")["items"]) < _CAMERAS and time.monotonic() < deadline_s:
        time.sleep(1.0)
    assert len({c["id"] for c in cameras}) == _CAMERAS, stack.state()
    assert len({(c["floor"], *c["position_m"]) for c in cameras}) == _CAMERAS
    assert not any(c["stale"] for c in cameras)


def test_a_mission_ends_with_an_outcome(stack: Stack) -> None:
    assert stack.get("/readyz")["ready"] is True
    mission = stack.search("couch")
    assert (mission["state"], mission["found"]) == ("done", True), f"{mission}\n{stack.state()}"
    assert mission["step"] > 0, f"the robot never moved: {mission}\n{stack.state()}"


def test_a_search_of_eight_cameras_and_two_workers_is_found_though_containers_are_killed(stack: Stack) -> None:
    stack.scale(camera=_PLACES, perception=2)
    until(lambda: len(stack.get("/api/v1/cameras")["items"]) == _PLACES, stack.state, 60.0)
    cameras = stack.get("/api/v1/cameras")["items"]
    assert len({(c["floor"], *c["position_m"]) for c in cameras}) == _PLACES
    workers = stack.get("/api/v1/perception")["items"]
    assert [w["ready"] and not w["stale"] for w in workers] == [True, True], workers
    mission = stack.search("toilet", killed=_KILLED)
    assert (mission["state"], mission["found"]) == ("done", True), f"{mission}\n{stack.state()}"


#: A node of another release or contract; it prints why it is refused, or stays until somebody has heard of it.
_STRANGER = """
import sys, surveilnav
from surveilnav import contract
surveilnav.__version__, contract.VERSION = sys.argv[1], int(sys.argv[2])
from surveilnav.bus import BusSettings, Node
from surveilnav.errors import BusError
try:
    with Node("recorder", "left-running", BusSettings(health_file=None)) as node:
        node.stopping.wait(30)
except BusError as error:
    print(error)
"""


def test_a_node_of_another_contract_is_refused_by_name_and_the_rest_goes_on(stack: Stack) -> None:
    said = stack.compose("exec", "-T", "gateway", "python", "-c", _STRANGER, "9.0.0", "2")
    assert "speaks contract 1, but this recorder is of release 9.0.0 and speaks contract 2" in said
    nodes = {f"{n['kind']}/{n['id']}": n for n in stack.get("/api/v1/traffic")["nodes"]}
    assert "recorder/left-running" not in nodes
    assert not any(n["other_release"] for n in nodes.values()), nodes
    assert stack.get("/readyz")["ready"] is True


def test_a_node_of_another_release_is_named(stack: Stack) -> None:
    stack.compose("exec", "--detach", "gateway", "python", "-c", _STRANGER, "0.0.9", "1")

    def named() -> list[tuple[str, str]]:
        nodes = stack.get("/api/v1/traffic")["nodes"]
        return [(n["id"], n["release"]) for n in nodes if n["other_release"] and not n["stale"]]

    assert until(named, "nobody named it", 30.0) == [("left-running", "0.0.9")]


def test_maps_and_missions_outlive_their_containers(stack: Stack) -> None:
    before = stack.get("/api/v1/missions")["items"]
    assert before, "this test needs the mission of the one above"
    stack.compose("rm", "--stop", "--force", "planner")
    stack.compose("up", "--detach", "--wait", "--no-deps", "planner", timeout_s=120)
    kept = stack.compose("exec", "-T", "planner", "sh", "-c", "stat -c '%u %n' /var/lib/surveilnav/*/planner.sqlite")
    assert kept.split() == ["10001", "/var/lib/surveilnav/parametric_flat-0/planner.sqlite"]
    said = stack.compose("logs", "--no-color", "planner")
    assert "store_" not in said, said
    stack.compose("restart", "gateway", timeout_s=120)  # so that it remembers nothing
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        try:
            after = stack.get("/api/v1/missions")["items"]
        except httpx.HTTPError:
            after = []
        if after:
            break
        time.sleep(1.0)
    assert [(m["id"], m["state"], m["found"]) for m in after] == [(m["id"], m["state"], m["found"]) for m in before]
