"""A house of two floors with a fusion service for each: the robot takes the stairs from one's floor to the other's."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from surveilnav.bus.router import free_port
from surveilnav.cli.replay.check import check
from surveilnav.client import Client
from surveilnav.contract import MAP_REVISION, RECORDINGS
from surveilnav.messages import FINISHED_STATES
from tests.e2e.conftest import System, starting
from tests.waiting import until

pytestmark = pytest.mark.slow
SHARDS = {"low": ["0"], "high": ["1"]}


@pytest.fixture(scope="module")
def sharded(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[System]:
    with starting(tmp_path_factory.mktemp("sharded"), home_cache) as start:
        yield start(
            "parametric_house",
            cameras=5,
            robot_start="5,4.25,1,0",
            gateway_port=free_port(),
            recorder=True,
            shards=json.dumps(SHARDS),
        )


def floors_of(s: System) -> set[str]:
    return {row.ids["floor"] for row in s.node.ask_all(MAP_REVISION)}


def test_a_mission_crosses_shards_and_its_recording_makes_the_maps_of_both(sharded):
    s = sharded
    assert s.node.alive("fusion") == {"low", "high"}
    s.search("refrigerator", mission="down", max_steps=400)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 400, "down")
    assert (ended.state, ended.found, ended.floor) == ("done", True, "0"), ended
    assert floors_of(s) == {"0", "1"}
    state = Path(s.stack.environment["SURVEILNAV_FUSION__STORE"]).parent
    assert {path.name for path in state.glob("fusion-*.sqlite")} == {"fusion-low.sqlite", "fusion-high.sqlite"}
    rows = until(
        lambda: [r for t in s.node.ask_all(RECORDINGS) for r in t.message.recordings if r.state == "complete"],
        timeout_s=60.0,
    )
    outcome = check(Path(s.stack.environment["SURVEILNAV_RECORDER__FOLDER"]) / f"{rows[0].id}.mcap")
    assert outcome.same, outcome.in_words()
    assert len(outcome.recorded.split()) == 2, "the maps of both"


def test_rest_shows_one_building(sharded):
    s = sharded
    with Client(f"http://127.0.0.1:{s.gateway_port}") as client:
        assert {floor.id for floor in client.floors()} == {"0", "1"}
        found = client.where("bed", max_s=40)
        cameras = {camera.id for camera in found.cameras}
        assert cameras == {camera.name for camera in s.building.plan.cameras}
        seen_on = {record.floor for record in client.objects()}
        assert seen_on == {"0", "1"}


def test_a_killed_service_comes_back_with_its_maps_while_the_other_works_on(sharded):
    s = sharded
    until(lambda: floors_of(s) == {"0", "1"}, timeout_s=30.0)
    before = {r.ids["floor"]: r.message.revision for r in s.node.ask_all(MAP_REVISION)}
    logs = {name: s.stack.log_of(name).read_text() for name in ("fusion-1", "fusion-2")}
    low = next(name for name, text in logs.items() if "shard=low" in text)
    s.kill(low)
    until(lambda: s.node.alive("fusion") == {"high"}, timeout_s=30.0)
    assert floors_of(s) == {"1"}
    s.stack.start(low)
    until(lambda: floors_of(s) == {"0", "1"}, timeout_s=90.0)
    after = {r.ids["floor"]: r.message.revision for r in s.node.ask_all(MAP_REVISION)}
    assert after["0"] >= before["0"] > 0
