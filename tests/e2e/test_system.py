"""The whole system: what a dead service does, what garbage on the bus does, and missions by bus and gateway."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import httpx
import pytest
import zenoh

from surveilnav.bus import clock_ns
from surveilnav.contract import MISSION_CANCEL, MISSION_STATUS, ROBOT_STATUS, STREAMS
from surveilnav.messages import FINISHED_STATES, MissionCancel
from tests.e2e.conftest import frame_bytes
from tests.waiting import until


@pytest.mark.slow
def test_without_surveillance_no_camera_sends_a_frame(system):
    s = system(cameras=1, surveillance=False)
    s.search("tv", max_steps=30)
    s.wait(lambda m: m.step >= 10 or m.state in FINISHED_STATES, 90)
    assert frame_bytes(s.traffic("camera", s.building.plan.cameras[0].name)) == 0


@pytest.mark.slow
def test_a_mission_survives_the_death_of_perception(system):
    s, mission = system(cameras=1), "perception-dies"
    s.search("tv", mission=mission)
    s.wait(lambda m: m.step >= 5, 90, mission)
    s.kill("perception")
    held = s.wait(lambda m: "perception" in m.message.lower(), 60, mission)
    assert held.state in ("active", "confirming")
    time.sleep(2.0)
    assert s.status(mission).step == held.step, "the robot holds still while nobody sees"
    s.stack.start("perception")
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 180, mission)
    assert (ended.state, ended.found) == ("done", True), ended
    assert ended.step > held.step


@pytest.mark.slow
def test_garbage_on_every_key_stops_nothing(running):
    s, mission = running, "garbage"
    ids = {
        "building": s.node.building,
        "floor": "0",
        "camera": s.building.plan.cameras[0].name,
        "robot": "r1",
        "view": "0",
        "worker": "perception-1",
        "mission": mission,
        "layer": "value",
        "node": "robot-r1",
        "fusion": "fusion",
        "source": "robot-r1",
        "supervisor": "up",
        "recorder": "recorder",
        "keeper": "fusion",
        "player": "replay",
        "passage": "lobby",
    }
    keys = {stream: stream.key_for(**{f: ids[f] for f in stream.fields}) for stream in STREAMS}
    s.search("tv", mission=mission)
    s.wait(lambda m: m.step >= 1, 90, mission)
    garbage = [b"", b"\xff" * 1000, b"\x81\xa8stamp_ns\xc0", b"{}", bytes(200_000)]
    stranger = zenoh.open(zenoh.Config.from_json5(s.stack.bus.client_config()))
    for stream, key in keys.items():
        for schema in (stream.schema, "surveilnav.Other/1.0", ""):
            for payload in garbage:
                encoding = zenoh.Encoding("application/msgpack").with_schema(schema)
                stranger.put(key, payload, encoding=encoding, attachment=payload)
                if "query" in stream.kind:
                    for _ in stranger.get(key, payload=payload, encoding=encoding, timeout=2.0):
                        pass
    stranger.close()
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 120, mission)
    assert (ended.state, ended.found) == ("done", True), ended
    s.stack.check()
    assert s.traffic("fusion", "fusion").rejected
    assert s.traffic("planner", "planner").rejected


@pytest.mark.slow
def test_a_mission_survives_the_death_of_its_planner(running):
    s, mission = running, "planner-dies"
    before = s.node.ask(ROBOT_STATUS, robot="r1").message.seq
    s.search("bed", mission=mission)
    steps = []
    for _ in range(3):
        reached = (steps[-1] if steps else 0) + 4
        steps.append(
            s.wait(lambda m, reached=reached: m.step >= reached or m.state in FINISHED_STATES, 90, mission).step
        )
        s.kill("planner")
        s.stack.start("planner")
        until(lambda: s.node.ask_all(MISSION_STATUS, mission=mission), "the planner is back without its mission", 30.0)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 180, mission)
    assert (ended.state, ended.found) == ("done", True), ended
    assert steps[-1] < ended.step, "each time in the midst of it"
    seq = s.node.ask(ROBOT_STATUS, robot="r1").message.seq
    assert seq - before == ended.step, "as many actions as were decided: none twice, none lost"
    s.kill("planner")
    s.stack.start("planner")
    until(lambda: s.node.ask_all(MISSION_STATUS, mission=mission), timeout_s=30.0)

    def told() -> list[tuple[str, str, bool]]:
        missions = httpx.get(f"http://127.0.0.1:{s.gateway_port}/api/v1/missions").raise_for_status().json()["items"]
        return [(m["id"], m["state"], m["found"]) for m in missions if m["id"] == mission]

    until(lambda: told() == [(mission, "done", True)], told, 20.0)  # the gateway hears of its end a moment later


@pytest.mark.slow
def test_goals_that_cannot_be_met_are_refused_and_cancel_stops_the_robot(running):
    s = running
    unknown = s.submit("?!", mission="bad")
    assert (unknown.accepted, unknown.error) == (False, "bad_target")
    assert "'?!'" in unknown.message
    assert "fire extinguisher" in unknown.message
    s.search("toilet", mission="m1")
    s.wait(lambda m: m.step >= 2, 60)
    second = s.submit("bed", mission="m2")
    assert (second.accepted, second.error) == (False, "no_free_robot")
    s.node.ask(MISSION_CANCEL, MissionCancel(stamp_ns=clock_ns(), mission="m1"), mission="m1")
    assert s.wait(lambda m: m.state in FINISHED_STATES, 20).state == "cancelled"
    time.sleep(1.0)
    before = s.node.ask(ROBOT_STATUS, robot="r1").message.seq
    time.sleep(1.0)
    assert s.node.ask(ROBOT_STATUS, robot="r1").message.seq == before


@pytest.mark.slow
def test_find_and_status_through_the_gateway(running):
    url = f"http://127.0.0.1:{running.gateway_port}"

    def surveilnav(*arguments):
        command = [sys.executable, "-m", "surveilnav.cli.main", *arguments, "--url", url, "--json"]
        return subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)

    run = until(lambda: (done := surveilnav("status")).returncode == 0 and done, timeout_s=30.0)
    facts = json.loads(run.stdout)
    assert [r["id"] for r in facts["robots"]["items"]] == ["r1"]
    assert [c["id"] for c in facts["cameras"]["items"]] == ["c0-1"]
    refused = surveilnav("find", "?!")
    assert refused.returncode == 1
    assert "fire extinguisher" in refused.stderr
    error = json.loads(refused.stdout)["error"]
    assert (error["type"], error["name"]) == ("GatewayError", "bad_target")
    assert "fire extinguisher" in error["message"]
    assert "Traceback" not in refused.stderr
    run = surveilnav("find", "tv")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["found"] is True
    found = json.loads(run.stdout)["id"]
    until(lambda: json.loads(surveilnav("missions", "show", found).stdout)["judged"] is True, timeout_s=60.0)
    first = json.loads(surveilnav("objects", "television set").stdout)["items"][0]
    assert first.get("relevance") is not None
    assert json.loads(surveilnav("objects", "tv", "--label", "tv").stdout)["items"][0]["label"] == "tv"
