"""compose.secure.yaml on a real Docker engine: a mission with certificates and keys, and nobody let in without."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from surveilnav.security.api_keys import ApiKeysFile
from tests.compose.stack import MISSION_S, UP_S, Stack, create_security, missing
from tests.waiting import until

#: Places for cameras; at first two of them are taken.
_CAMERAS = 8
_NAMES = ("router", "fusion", "planner", "gateway", "recorder", "perception", "supervisor", "cameras", "robot-r1")
#: Run in a container: tries to reach the router, and prints what came of it.
_KNOCK = """
import zenoh, sys
config = zenoh.Config.from_json5('{"mode": "client", "connect": {"endpoints": ["%s"], "timeout_ms": 2000}}' % sys.argv[1])
try:
    zenoh.open(config)
    print("let in")
except zenoh.ZError:
    print("refused")
"""
pytestmark = [pytest.mark.compose, pytest.mark.slow, pytest.mark.timeout(UP_S + 2 * MISSION_S)]


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return {"folder": str(tmp_path_factory.mktemp("secrets") / "security")}


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory, keys: dict[str, str]) -> Iterator[Stack]:
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    if os.geteuid() != 0:
        pytest.skip("secrets are given to the containers' user, which needs root")
    folder = Path(keys["folder"])
    keys |= create_security(folder, _NAMES, simulation=True)
    stack = Stack(
        tmp_path_factory.mktemp("models"),
        "compose.yaml",
        "compose.secure.yaml",
        SURVEILNAV_SIM__BUILDING="parametric_flat",
        SURVEILNAV_SIM__CAMERAS=str(_CAMERAS),
        SURVEILNAV_PERCEPTION__BACKEND="oracle",
        SURVEILNAV_SECURITY_DIR=str(folder),
    )
    with stack.running():
        yield stack


def test_a_mission_needs_a_key_and_is_found(stack: Stack, keys: dict[str, str]) -> None:
    assert stack.gateway.get("/api/v1/missions").status_code == 401
    goal = {"target": "couch", "max_steps": 200}
    viewer = {"Authorization": f"Bearer {keys['viewer']}"}
    assert stack.gateway.post("/api/v1/missions", json=goal, headers=viewer).status_code == 403
    stack.gateway.headers["Authorization"] = f"Bearer {keys['operator']}"
    answer = stack.gateway.post("/api/v1/missions", json=goal)
    assert answer.status_code == 202, answer.text
    mission = stack.wait_for_end(answer.json()["id"])
    assert (mission["state"], mission["found"]) == ("done", True), f"{mission}\n{stack.state()}"
    cameras = stack.get("/api/v1/cameras")["items"]
    assert len(cameras) == 2
    assert stack.gateway.get(f"/api/v1/cameras/{cameras[0]['id']}/views/0.jpg").status_code == 200


def test_a_search_of_eight_cameras_and_two_workers_is_found_though_containers_are_killed(
    stack: Stack, keys: dict[str, str]
) -> None:
    stack.gateway.headers["Authorization"] = f"Bearer {keys['operator']}"
    stack.scale(camera=_CAMERAS, perception=2)
    until(lambda: len(stack.get("/api/v1/cameras")["items"]) == _CAMERAS, stack.state, 60.0)
    assert [w["ready"] for w in stack.get("/api/v1/perception")["items"]] == [True, True]
    mission = stack.search("toilet", killed=("camera", "perception", "fusion", "planner"))
    assert (mission["state"], mission["found"]) == ("done", True), f"{mission}\n{stack.state()}"


@pytest.mark.parametrize("endpoint", ["tcp/router:7447", "tls/router:7447"])
def test_who_reaches_the_router_without_a_certificate_isnt_let_in(stack: Stack, endpoint: str) -> None:
    said = stack.compose("exec", "-T", "gateway", "python", "-c", _KNOCK, endpoint)
    assert said.split() == ["refused"]


def test_a_revoked_key_is_refused_at_once(stack: Stack, keys: dict[str, str]) -> None:
    admin = {"Authorization": f"Bearer {keys['admin']}"}
    assert stack.gateway.get("/api/v1/missions", headers=admin).status_code == 200
    ApiKeysFile(Path(keys["folder"]) / "gateway" / "api_keys.json").revoke("admin")
    assert stack.gateway.get("/api/v1/missions", headers=admin).status_code == 401
    said = stack.compose("logs", "--no-color", "gateway")
    assert '"event": "commanded"' in said
    for key in (keys["viewer"], keys["operator"], keys["admin"]):
        assert key.split("_", 2)[2] not in said
