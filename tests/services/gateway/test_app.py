"""REST over a real bus: what is there, what isn't, and what people get wrong."""

from __future__ import annotations

import io
import re
import time
from contextlib import ExitStack
from typing import Any

import cv2
import httpx
import msgspec
import numpy as np
import pytest

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Node, clock_ns
from surveilnav.geometry import Grid
from tests.waiting import until

SURROGATE = b'{"target": "\\ud800"}'


def problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    """The problem details of an answer, checked for their form (RFC 9457)."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body: dict[str, Any] = answer.json()
    assert body["status"] == status
    assert body["type"].startswith("urn:surveilnav:problem:")
    assert body["title"]
    assert body["detail"]
    return body


def named(body: dict[str, Any]) -> str:
    return str(body["type"]).rsplit(":", 1)[1]


def submit(client: httpx.Client, target: str = "potted plant", **headers: str) -> httpx.Response:
    return client.post("/api/v1/missions", json={"target": target}, headers=headers)


# --- missions -----------------------------------------------------------------------------------------------------


def test_submit_gives_a_mission_and_where_it_is(client, building):
    answer = client.post("/api/v1/missions", json={"target": "  tv ", "robot": "r1", "max_steps": 7})
    assert answer.status_code == 202, answer.text
    goal = building.goals[-1]
    assert (goal.target, goal.robot, goal.max_steps) == ("tv", "r1", 7)
    assert answer.headers["location"] == f"/api/v1/missions/{goal.mission}"
    mission = client.get(answer.headers["location"]).json()
    assert (mission["id"], mission["target"], mission["state"], mission["stale"]) == (
        goal.mission,
        "tv",
        "queued",
        False,
    )
    assert mission["last_seen"].endswith("Z")


def test_missions_are_listed_newest_first_and_in_pages(client):
    ids = [submit(client).json()["id"] for _ in range(3)]
    until(lambda: client.get("/api/v1/missions?limit=1").json()["items"][0]["id"] == ids[-1], "the newest isn't first")
    everything = client.get("/api/v1/missions").json()
    page = client.get("/api/v1/missions?limit=2&offset=1").json()
    assert [x["id"] for x in page["items"]] == [x["id"] for x in everything["items"]][1:3] == ids[1::-1]
    assert page["total"] == everything["total"] >= 3


def test_status_of_a_mission_follows_the_planner(client, building):
    id = submit(client).json()["id"]
    building.put_status(
        m.MissionStatus(
            stamp_ns=clock_ns(),
            mission=id,
            target="potted plant",
            robot="r1",
            state="failed",
            phase="",
            step=500,
            max_steps=500,
            path_m=float("inf"),
            floor="1",
            error="out_of_steps",
            message="500 steps",
            floor_choice_bytes=1234,
        )
    )
    until(lambda: client.get(f"/api/v1/missions/{id}").json()["state"] == "failed", "the state never changed")
    mission = client.get(f"/api/v1/missions/{id}").json()
    assert (mission["error"], mission["step"], mission["path_m"]) == ("out_of_steps", 500, None)
    assert (mission["floor"], mission["floor_choice_bytes"]) == ("1", 1234)
    problem(client.post(f"/api/v1/missions/{id}/cancel"), 409)


def test_what_the_simulator_says_of_a_stop_stands_beside_found(client, building):
    id = submit(client).json()["id"]
    status = until(lambda: building.missions.get(id))
    verdict = m.Judged(stamp_ns=clock_ns(), mission=id, robot="r1", success=False, distance_m=2.0)
    building.robot.publisher(contract.JUDGED, source="robot-r1", mission=id).put(verdict)
    done = {"stamp_ns": clock_ns(), "state": "done", "found": True}
    building.put_status(msgspec.structs.replace(status, **done))
    until(lambda: client.get(f"/api/v1/missions/{id}").json()["judged"] is False, "it was never heard")
    assert client.get(f"/api/v1/missions/{id}").json()["found"] is True
    assert next(x for x in client.get("/api/v1/missions").json()["items"] if x["id"] == id)["judged"] is False


def test_cancel(client, building):
    id = submit(client).json()["id"]
    answer = client.post(f"/api/v1/missions/{id}/cancel", json={"reason": "found it myself"})
    assert (answer.status_code, answer.json()["state"]) == (202, "cancelled")


def test_pause_and_resume(client, building):
    id = submit(client).json()["id"]
    answer = client.post(f"/api/v1/missions/{id}/pause", json={"reason": "visitors"})
    assert (answer.status_code, answer.json()["state"]) == (202, "paused")
    until(lambda: client.get(f"/api/v1/missions/{id}").json()["state"] == "paused", "it was never paused")
    answer = client.post(f"/api/v1/missions/{id}/resume")
    assert (answer.status_code, answer.json()["state"]) == (202, "active")


@pytest.mark.parametrize("what", ["pause", "resume"])
def test_what_cant_be_paused(client, building, what):
    for id in ("m-unknown", "*", "a%2Fb"):
        answer = client.post(f"/api/v1/missions/{id}/{what}")
        problem(answer, answer.status_code)
        assert answer.status_code in (404, 422)
    id = submit(client).json()["id"]
    building.put_status(msgspec.structs.replace(building.missions[id], stamp_ns=clock_ns(), state="done"))
    assert named(problem(client.post(f"/api/v1/missions/{id}/{what}"), 409)) == "finished"
    problem(client.post("/api/v1/missions/m-1/pause", json={"reason": "x" * 501}), 422)


def test_a_goal_may_wait_for_a_robot(client, building):
    assert client.post("/api/v1/missions", json={"target": "tv", "queue": True}).status_code == 202
    assert building.goals[-1].queue
    assert named(problem(client.post("/api/v1/missions", json={"target": "tv", "queue": "later"}), 422)) == "invalid"


def test_all_robots_stop_and_are_released(client, building):
    under_way = submit(client).json()["id"]
    answer = client.post("/api/v1/robots/stop", json={"reason": "smoke"})
    try:
        assert answer.status_code == 200, answer.text
        assert {"robot": "r1", "halted": True, "stale": False} in answer.json()["items"]
        assert building.halt_reasons[-1] == "smoke"
        until(lambda: client.get(f"/api/v1/missions/{under_way}").json()["state"] == "paused", "it goes on")
        assert client.get(f"/api/v1/missions/{under_way}").json()["message"] == "emergency stop: smoke"
        id = submit(client).json()["id"]
        assert named(problem(client.post(f"/api/v1/missions/{id}/resume"), 409)) == "robot_halted"
    finally:
        answer = client.post("/api/v1/robots/release")
    assert {"robot": "r1", "halted": False, "stale": False} in answer.json()["items"]
    assert not building.halted
    problem(client.post("/api/v1/robots/stop", json={"reason": "x" * 201}), 422)


def test_a_robot_that_doesnt_say_that_it_stopped_is_named(client, building):
    with Node("robot", "deaf", building.settings):
        until(lambda: client.post("/api/v1/robots/stop").status_code == 504, "a silent robot went unnoticed")
        told = problem(client.post("/api/v1/robots/stop"), 504)
        assert "deaf" in told["detail"]
        assert {"robot": "r1", "halted": True, "stale": False} in told["robots"]
    until(lambda: client.post("/api/v1/robots/release").status_code == 200, "one that left is waited for")


def test_plan_of_a_mission(client):
    id = submit(client).json()["id"]
    plan = client.get(f"/api/v1/missions/{id}/plan").json()
    assert plan["waypoint"]["kind"] == "frontier"
    assert plan["path_m"] == [[0.0, 0.0], [1.5, 0.2], [None, 1.0]]  # what isn't finite is null, not a crash
    assert plan["stale"] is False
    assert (plan["why"], plan["candidates"][0]["note"]) == ("to a frontier, 3.0 m", "nearest with value")


def test_the_same_idempotency_key_is_one_mission(client, building):
    first, again = (submit(client, "couch", **{"Idempotency-Key": "k1"}) for _ in range(2))
    assert first.json()["id"] == again.json()["id"]
    assert first.headers["location"] == again.headers["location"]
    assert again.status_code == 202
    assert sum(g.mission == first.json()["id"] for g in building.goals) == 1
    assert submit(client, "couch").json()["id"] != first.json()["id"]
    assert submit(client, "couch", **{"Idempotency-Key": "k2"}).json()["id"] != first.json()["id"]
    assert named(problem(submit(client, "bed", **{"Idempotency-Key": "k1"}), 422)) == "idempotency_key_reused"
    other_effort = {"target": "couch", "max_steps": 9}
    problem(client.post("/api/v1/missions", json=other_effort, headers={"Idempotency-Key": "k1"}), 422)


def test_an_idempotency_key_outlives_the_gateway(client, building, router, start_gateway):
    first = submit(client, "toilet", **{"Idempotency-Key": "before"})
    goals = len(building.goals)
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack)
        with httpx.Client(base_url=url) as another:
            assert submit(another, "toilet", **{"Idempotency-Key": "before"}).json()["id"] == first.json()["id"]
            problem(submit(another, "bed", **{"Idempotency-Key": "before"}), 422)
    assert len(building.goals) == goals


def test_a_mission_has_perception_s_name_and_the_word_that_was_typed(client, building, router, start_gateway):
    first = submit(client, "Fernseher", **{"Idempotency-Key": "in German"}).json()
    assert first["target"] == "tv"
    mission = client.get(f"/api/v1/missions/{first['id']}").json()
    assert (mission["target"], mission["asked"]) == ("tv", "Fernseher")
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack)
        with httpx.Client(base_url=url) as another:
            for word in ("Fernseher", "TV"):
                assert submit(another, word, **{"Idempotency-Key": "in German"}).json()["id"] == first["id"]


@pytest.mark.parametrize(
    ("target", "status", "name"),
    [
        ("unicorn", 422, "bad_target"),
        ("Blumentopf 🌱", 422, "bad_target"),
        ("busy robot", 409, "no_free_robot"),
        ("explode", 502, "internal"),
    ],
)
def test_the_planners_refusals(client, target, status, name):
    assert named(problem(submit(client, target), status)) == name


def test_a_target_in_unicode_arrives_as_it_was_typed(client, building):
    assert submit(client, "растение в горшке 盆栽").status_code == 202
    assert building.goals[-1].target == "растение в горшке 盆栽"


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"target":', 400),
        (b"", 422),
        (b"\xff\xfe\x00", 400),
        (b"[" * 50_000, 400),
        (SURROGATE, 422),
        (b'{"target": "tv", "\\ud800": 1}', 422),
        (b"{}", 422),
        (b'{"target": ""}', 422),
        (b'{"target": "   "}', 422),
        (b'{"target": 3}', 422),
        (b'{"target": "tv", "robot": "../r1"}', 422),
        (b'{"target": "tv", "max_steps": 0}', 422),
        (b'{"target": "tv", "max_steps": 1e999}', 422),
        (b'{"target": "tv", "steps": 3}', 422),
        (b'{"target": "' + b"x" * 201 + b'"}', 422),
        (b'{"target": "' + b"x" * 70_000 + b'"}', 413),
    ],
)
def test_malformed_goals(client, building, body, status):
    goals = len(building.goals)
    problem(client.post("/api/v1/missions", content=body, headers={"content-type": "application/json"}), status)
    assert len(building.goals) == goals


def test_a_body_without_a_length_is_refused(client):
    problem(client.post("/api/v1/missions", content=iter([b'{"target": "tv"}'])), 411)


@pytest.mark.parametrize("method", ["GET", "POST", "OPTIONS"])
@pytest.mark.parametrize("path", ["/", "/healthz", "/api/v1/missions", "/nowhere"])
def test_a_request_for_a_strangers_name_is_refused(client, method, path):
    told = problem(client.request(method, path, headers={"host": "rebound.example:8080"}), 421)
    assert named(told) == "foreign_host"
    assert told["instance"] == path
    assert "'rebound.example:8080'" in told["detail"]
    assert "SURVEILNAV_GATEWAY__ALLOWED_HOSTS" in told["detail"]


@pytest.mark.parametrize(
    "path", ["robots/release", "robots/stop", "missions/m-1/cancel", "cameras/c1/pause", "missions"]
)
def test_a_page_of_another_site_changes_nothing_here(client, building, path):
    before = len(building.halt_reasons), len(building.goals)
    for origin in ("http://evil.example", "null"):
        told = problem(client.post(f"/api/v1/{path}", headers={"origin": origin}), 403)
        assert named(told) == "foreign_page"
    assert (len(building.halt_reasons), len(building.goals)) == before
    assert client.get("/api/v1/robots", headers={"origin": "http://evil.example"}).status_code == 200


def test_the_gateways_own_pages_may_ask(client):
    assert (
        client.post("/api/v1/missions", json={"target": "tv"}, headers={"origin": str(client.base_url)}).status_code
        == 202
    )


def test_a_host_that_is_none_breaks_nothing(client):
    assert named(problem(client.get("/healthz", headers={"host": "["}), 421)) == "foreign_host"


def test_loopback_by_any_of_its_names_is_answered(client):
    for host in ("localhost", "localhost:8080", "127.0.0.1", "[::1]:8080"):
        assert client.get("/healthz", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "id", ["m-unknown", "..%2F..%2Fetc", "*", "**", "%00", "a%2Fb", "a" * 65, "%F0%9F%8C%B1", "$*", "a b"]
)
@pytest.mark.parametrize(
    "path",
    [
        "missions/{}",
        "missions/{}/plan",
        "cameras/{}",
        "cameras/{}/views/0.jpg",
        "floors/{}/layers/occupancy.png",
        "objects?floor={}",
    ],
)
def test_hostile_and_unknown_ids(client, path, id):
    answer = client.get(f"/api/v1/{path.format(id)}")
    problem(answer, answer.status_code)
    assert answer.status_code in (404, 422)


@pytest.mark.parametrize("id", ["m-unknown", "*", "a%2Fb"])
def test_cancelling_what_isnt_there(client, id):
    answer = client.post(f"/api/v1/missions/{id}/cancel")
    problem(answer, answer.status_code)
    assert answer.status_code in (404, 422)


# --- cameras, robots, perception ----------------------------------------------------------------------------------


def test_cameras(client):
    (camera,) = client.get("/api/v1/cameras").json()["items"]
    assert camera == client.get("/api/v1/cameras/c1").json() | {"last_seen": camera["last_seen"]}
    assert (camera["id"], camera["floor"], camera["invoked"], camera["views_processed"]) == ("c1", "0", True, 2)
    assert camera["labels"] == {"couch": 0.8}
    assert camera["views"][3]["yaw_rad"] == pytest.approx(np.pi / 2)
    assert camera["views"][3]["pitch_rad"] == pytest.approx(-np.pi / 6)
    assert camera["views"][12]["yaw_rad"] is None  # straight down has no azimuth
    assert not camera["stale"]


def test_a_view_is_fetched_from_the_camera(client, building):
    asked = building.thumbnails
    answer = client.get(client.get("/api/v1/cameras/c1").json()["views"][5]["picture"])
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/jpeg")
    assert building.thumbnails == asked + 1
    picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (48, 64, 3)
    assert abs(int(picture.mean()) - 50) < 3


@pytest.mark.parametrize(
    ("view", "status"), [("13", 404), ("-1", 422), ("x", 422), ("11", 502), ("99999999999999999999", 422)]
)
def test_views_that_arent_there(client, view, status):
    problem(client.get(f"/api/v1/cameras/c1/views/{view}.jpg"), status)


def test_the_latest_picture_is_made_once_for_all_viewers(client, building):
    asked, began_s = building.thumbnails, time.monotonic()
    first = client.get("/api/v1/cameras/c1/latest.jpg")
    assert (first.status_code, first.headers["content-type"]) == (200, "image/jpeg")
    for _ in range(5):
        again = client.get("/api/v1/cameras/c1/latest.jpg", headers={"If-None-Match": first.headers["etag"]})
        assert again.status_code == 304
    assert building.thumbnails - asked <= 1 + (time.monotonic() - began_s), "more than one a second was made"
    other = client.get("/api/v1/cameras/c1/latest.jpg?view=5")
    assert other.headers["etag"] != first.headers["etag"]
    for path, status in (("c1/latest.jpg?view=13", 404), ("c9x/latest.jpg", 404), ("c1/latest.jpg?view=-1", 422)):
        problem(client.get(f"/api/v1/cameras/{path}"), status)


def test_cones_lie_on_the_floor_in_front_of_the_camera(client):
    cones = client.get("/api/v1/cameras/c1/cones").json()["items"]
    assert [c["view"] for c in cones] == list(range(13))
    east = np.array(cones[0]["outline_m"])  # the camera stands at (2, 1)
    assert (east[:, 0] > 2).all()
    assert np.abs(east[:, 1].mean() - 1) < 0.01
    problem(client.get("/api/v1/cameras/nobody/cones"), 404)


def test_a_camera_is_paused_and_resumed(client):
    answer = client.post("/api/v1/cameras/c1/pause")
    try:
        assert (answer.status_code, answer.json()["paused"]) == (202, True)
        until(lambda: client.get("/api/v1/cameras/c1").json()["paused"], "it never said that it is paused")
        assert named(problem(client.get("/api/v1/cameras/c1/views/3.jpg"), 409)) == "paused"
    finally:
        answer = client.post("/api/v1/cameras/c1/resume")
    assert answer.json()["paused"] is False
    assert client.get("/api/v1/cameras/c1/views/3.jpg").status_code == 200
    problem(client.post("/api/v1/cameras/nobody/pause"), 404)


def test_a_camera_that_is_gone_can_be_forgotten(client, building):
    assert named(problem(client.delete("/api/v1/cameras/c1"), 409)) == "camera_present"
    problem(client.delete("/api/v1/cameras/nobody"), 404)
    for _ in range(2):  # it may come back
        with Node("camera", "c6", building.settings) as passing:
            passing.publisher(contract.CAMERA_INFO, floor="0", camera="c6").put(_renamed(building.info, "c6"))
            until(lambda: client.get("/api/v1/cameras/c6").status_code == 200, "the camera never came")
        until(lambda: client.get("/api/v1/cameras/c6").json()["stale"], "the camera is gone but not stale")
        answer = client.delete("/api/v1/cameras/c6")
        assert (answer.status_code, answer.content) == (204, b"")
        problem(client.get("/api/v1/cameras/c6"), 404)


def test_a_camera_that_left_stays_listed_as_stale(client, building):
    def camera() -> dict[str, Any]:
        return dict(client.get("/api/v1/cameras/c9").json())

    with Node("camera", "c9", building.settings) as passing:
        publisher = passing.publisher(contract.CAMERA_INFO, floor="0", camera="c9")
        publisher.put(_renamed(building.info, "c9"))
        until(lambda: camera().get("stale") is False, "the camera never came")
    until(lambda: camera()["stale"] is True, "the camera is gone but not stale")
    assert named(problem(client.get("/api/v1/cameras/c9/views/1.jpg"), 503)) == "absent"


def test_a_message_that_names_another_id_than_its_key_isnt_believed(client, building):
    building.camera.publisher(contract.CAMERA_INFO, floor="0", camera="liar").put(_renamed(building.info, "../c1"))
    building.camera.publisher(contract.CAMERA_INFO, floor="0", camera="honest").put(_renamed(building.info, "honest"))
    until(lambda: client.get("/api/v1/cameras/honest").status_code == 200, "the honest one never came")
    assert {c["id"] for c in client.get("/api/v1/cameras").json()["items"]}.isdisjoint({"liar", "../c1"})


def _renamed(info: m.CameraInfo, camera: str) -> m.CameraInfo:
    return msgspec.structs.replace(info, camera=camera, stamp_ns=clock_ns())


def test_robots_and_perception(client, building):
    building.put_sources()
    until(lambda: not client.get("/api/v1/robots").json()["items"][0]["stale"], "the robot stays stale")
    (robot,) = client.get("/api/v1/robots").json()["items"]
    assert (robot["id"], robot["floor"], robot["state"]) == ("r1", "0", "ready")
    assert robot["position_m"] == [0.5, 0.25, 0.0]
    assert robot["yaw_rad"] == pytest.approx(1.0)
    assert (robot["frame_problem"], robot["frame_correction"]) == ("", None)
    (worker,) = client.get("/api/v1/perception").json()["items"]
    assert (worker["id"], worker["backend"], worker["why"], worker["stale"]) == ("w1", "simulated", "no weights", False)
    assert (worker["ready"], worker["models"]) == (True, {"detector": "d@1", "segmenter": "", "embedder": ""})
    assert worker["stages"]["queue"] == {"views": 3, "p50_ms": 8.0, "p95_ms": 8.0}
    assert worker["stages"]["odd"] == {"views": 1, "p50_ms": None, "p95_ms": None}


def test_a_robot_that_isnt_where_it_says_is_shown(client, building):
    building.put_sources()
    building.frames = [m.RobotFrameProblem("r1", "robot r1 isn't where it says", 0.5, -0.25, 0.1)]
    building.put_revision()
    until(lambda: client.get("/api/v1/robots").json()["items"][0]["frame_problem"], "the problem isn't shown")
    (robot,) = client.get("/api/v1/robots").json()["items"]
    assert robot["frame_problem"] == "robot r1 isn't where it says"
    assert robot["frame_correction"] == {"dx_m": 0.5, "dy_m": -0.25, "dyaw_rad": 0.1}
    building.frames = []
    building.put_revision()
    until(lambda: not client.get("/api/v1/robots").json()["items"][0]["frame_problem"], "the problem stays")


# --- maps ---------------------------------------------------------------------------------------------------------


def test_floors(client):
    (floor,) = client.get("/api/v1/floors").json()["items"]
    assert (floor["id"], floor["z_m"], floor["pending_views"], floor["stale"]) == ("0", 0.0, 1, False)
    assert floor["invoked"] == [{"camera": "c1", "views_processed": 2, "views": 13}]
    assert floor["robots"] == ["r1"]
    assert client.get(floor["layers"]["explored"]).status_code == 200


def decoded(answer: httpx.Response) -> np.ndarray:
    assert answer.headers["content-type"] == "image/png"
    bgra = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    return bgra[..., [2, 1, 0, 3]]


@pytest.mark.parametrize(
    ("layer", "rgb"),
    [("occupancy", (0x39, 0x42, 0x4E)), ("explored", (0xDB, 0xE7, 0xF0)), ("frontier", (0xF0, 0x8C, 0x00))],
)
def test_layers_are_north_up_in_the_documented_colours(client, layer, rgb):
    answer = client.get(f"/api/v1/floors/0/layers/{layer}.png")
    picture = decoded(answer)
    assert picture.shape == (12, 16, 4)
    assert (picture[-1, :4] == (*rgb, 255)).all()  # row 0 of the grid, the southernmost, is the lowest line
    assert (picture[:-1, :, 3] == 0).all()
    assert (picture[-1, 4:, 3] == 0).all()
    assert answer.headers["x-surveilnav-grid"] == "-1 -2 0.5 12 16"


def test_the_value_layer_is_coloured_from_low_to_high(client, building):
    answer = client.get("/api/v1/floors/0/layers/value.png", params={"target": "растение; a=b"})
    picture = decoded(answer)
    assert building.layers_asked[-1] == ("value", {"target": "растение; a=b"})
    assert tuple(picture[11, 0]) == (0x44, 0x01, 0x54, 255)
    assert tuple(picture[6, 5]) == (0xFD, 0xE7, 0x25, 255)
    assert (picture[..., 3] > 0).sum() == 2  # NaN is transparent
    assert answer.headers["x-surveilnav-range"] == "0.2 0.9"


def test_one_picture_of_a_layer_serves_all_who_ask_within_half_a_second(client, building):
    def get() -> str:
        return client.get("/api/v1/floors/0/layers/explored.png").headers["x-surveilnav-revision"]

    building.put_revision()
    asked, began_s = len(building.layers_asked), time.monotonic()
    for _ in range(20):
        get()
    assert len(building.layers_asked) - asked <= 1 + (time.monotonic() - began_s) / 0.5
    building.put_revision()
    until(lambda: get() == str(building.revision), "the old picture is served for ever")


def test_one_list_of_objects_serves_all_who_ask_within_a_second(client, building):
    asked, began_s = len(building.objects_asked), time.monotonic()
    for _ in range(20):
        assert client.get("/api/v1/objects").json()["total"] == 2
        assert client.get("/api/v1/objects?limit=1").json()["total"] == 2
    lists = [parameters for parameters in building.objects_asked[asked:] if not parameters]
    assert len(lists) <= 1 + (time.monotonic() - began_s)


@pytest.mark.parametrize(
    "path",
    [
        "floors/0/layers/cloud.png",
        "floors/0/layers/secret.png",
        "floors/9/layers/explored.png",
        "floors/0/layers/..%2Fx.png",
    ],
)
def test_unknown_layers_and_floors(client, path):
    problem(client.get(f"/api/v1/{path}"), 404)


def test_a_layer_that_doesnt_decode_is_fusions_fault(client, building):
    building.put_revision()
    building.broken_layer = True
    try:
        until(
            lambda: client.get("/api/v1/floors/0/layers/frontier.png").status_code == 502, "a broken layer was served"
        )
        assert named(problem(client.get("/api/v1/floors/0/layers/frontier.png"), 502)) == "bad_layer"
    finally:
        building.broken_layer = False


def test_objects_with_their_histories(client):
    assert client.get("/api/v1/objects").json()["total"] == 2
    for word in ("Sofa", "canapé"):
        (couch,) = client.get("/api/v1/objects", params={"floor": "0", "label": word}).json()["items"]
    assert (couch["label"], couch["status"], couch["confidence_robot"]) == ("couch", "confirmed", None)
    assert couch["history"][0]["what"] == "confirmed"
    assert couch["history"][0]["box_px"] == [1.0, 2.0, 30.0, 40.0]
    problem(client.get("/api/v1/objects?floor=7"), 404)


@pytest.mark.parametrize("form", ["png", "npy"])
def test_a_layer_that_the_client_has_already_isnt_sent_again(client, building, form):
    address = f"/api/v1/floors/0/layers/occupancy.{form}"
    first = client.get(address)
    tag = first.headers["etag"]
    for known in (tag, f'"other", W/{tag}', "*"):
        again = client.get(address, headers={"If-None-Match": known})
        assert (again.status_code, again.content) == (304, b"")
        assert (again.headers["etag"], again.headers["x-surveilnav-grid"]) == (tag, "-1 -2 0.5 12 16")
    assert client.get(address, headers={"If-None-Match": '"other"'}).content == first.content


def test_a_layer_as_an_array_with_its_place_in_the_world(client):
    layer = client.get("/api/v1/floors/0/layers/value", params={"target": "a & b"}).json()
    assert (layer["rows"], layer["cols"], layer["target"]) == (12, 16, "a & b")
    assert layer["T_world_cell"] == [[0.5, 0.0, -0.75], [0.0, 0.5, -1.75], [0.0, 0.0, 1.0]]
    assert (layer["low"], layer["high"]) == pytest.approx((0.2, 0.9))
    array = np.load(io.BytesIO(client.get(layer["array"]).content), allow_pickle=False)
    assert array.shape == (12, 16)
    assert array[5, 5] == pytest.approx(0.9)
    assert client.get(layer["picture"]).headers["content-type"] == "image/png"


@pytest.mark.parametrize(("layer", "status"), [("cloud", 404), ("secret", 404), ("x.gif", 422), ("a" * 65, 422)])
def test_layers_without_an_array(client, layer, status):
    problem(client.get(f"/api/v1/floors/0/layers/{layer}"), status)


def test_missions_by_cursor(client):
    ids = [submit(client).json()["id"] for _ in range(5)]
    until(lambda: client.get("/api/v1/missions?limit=1").json()["items"][0]["id"] == ids[-1], "the newest isn't first")
    got, asked = [], "limit=2"
    while len(got) < 5:
        page = client.get(f"/api/v1/missions?{asked}").json()
        got += [mission["id"] for mission in page["items"]]
        asked = f"limit=2&cursor={page['next']}"
        submit(client)  # what comes meanwhile shifts nothing
    assert got[:5] == ids[::-1]
    assert named(problem(client.get("/api/v1/missions?cursor=nonsense"), 422)) == "bad_cursor"


@pytest.mark.parametrize(
    ("asked", "labels"),
    [
        ({}, ["couch", "tv"]),
        ({"floor": "0", "min_confidence": "0.8"}, ["couch", "tv"]),
        ({"min_confidence": "0.81"}, []),
        ({"status": "rejected"}, []),
        ({"status": "confirmed", "label": "TV"}, ["tv"]),
    ],
)
def test_objects_by_what_they_must_be(client, asked, labels):
    found = client.get("/api/v1/objects", params=asked).json()
    assert [o["label"] for o in found["items"]] == labels
    assert found["total"] == len(labels)


@pytest.mark.parametrize(
    "asked", ["min_confidence=1.1", "min_confidence=nan", "min_confidence=x", "status=sure", "text=" + "x" * 201]
)
def test_objects_that_cant_be_asked_for(client, asked):
    problem(client.get(f"/api/v1/objects?{asked}"), 422)


def test_one_object_with_its_whole_history(client, building):
    couch = client.get("/api/v1/floors/0/objects/0").json()
    assert (couch["id"], couch["label"], couch["history"][0]["note"]) == (0, "couch", "0.80 >= 0.5")
    assert {"object": "0"} in building.objects_asked  # the gateway asks for all of them, too


@pytest.mark.parametrize(
    ("floor", "id", "status"), [("0", 7, 404), ("9", 0, 404), ("0", -1, 422), ("0", 2**31, 422), ("0", "x", 422)]
)
def test_one_object_that_isnt_there(client, floor, id, status):
    problem(client.get(f"/api/v1/floors/{floor}/objects/{id}"), status)


def test_the_building(client):
    def found() -> dict[str, Any]:
        answer = client.get("/api/v1/buildings").json()
        assert answer["total"] == 1
        return dict(answer["items"][0])

    until(lambda: found()["ready"], "the building never became ready")
    assert (found()["id"], found()["stale"], found()["floors"]) == ("building", False, ["0"])
    assert found()["cameras"] >= 1
    assert found()["last_seen"]


@pytest.mark.parametrize("query", ["limit=0", "limit=1001", "limit=x", "offset=-1"])
def test_limits(client, query):
    problem(client.get(f"/api/v1/cameras?{query}"), 422)


def test_traffic_names_nodes_and_cameras(client):
    client.get("/api/v1/cameras/c1/views/2.jpg")

    def camera() -> dict[str, Any]:
        return next((c for c in client.get("/api/v1/traffic").json()["cameras"] if c["id"] == "c1"), {})

    until(lambda: camera().get("viewer_bytes", 0) > 300, "the thumbnail isn't counted")
    traffic = client.get("/api/v1/traffic").json()
    assert camera()["node"] == "camera/c1"
    assert camera()["frame_bytes"] == 0
    assert camera()["wire_sent_bytes"] > 0
    nodes = {n["id"]: n for n in traffic["nodes"]}
    assert {"c1", "r1", "w1", "f1", "p1"} <= set(nodes)
    assert [n["kind"] for n in nodes.values()].count("gateway") >= 1
    assert all(
        {"last_seen", "stale", "offered_bytes", "delivered_bytes", "wire_sent_bytes"} <= set(n) for n in nodes.values()
    )
    assert traffic["offered_bytes"] == sum(n["offered_bytes"] for n in nodes.values())


def test_traffic_over_time_adds_up(client):
    def total(step: str) -> int:
        points = client.get(f"/api/v1/traffic/series?step={step}").json()["points"]
        return sum(p["camera_bytes"] + p["robot_bytes"] + p["server_bytes"] + p["simulation_bytes"] for p in points)

    client.get("/api/v1/cameras/c1/views/2.jpg")
    until(lambda: total("second") > 0, "nothing is counted over time")
    until(lambda: total("second") == total("minute"))
    rows = client.get("/api/v1/traffic/series.csv?step=second")
    assert rows.headers["content-type"].startswith("text/csv")
    header, *lines = rows.text.splitlines()
    assert header == "at,camera_bytes,robot_bytes,server_bytes,simulation_bytes"
    assert len(lines) >= 1
    problem(client.get("/api/v1/traffic/series?step=hour"), 422)
    problem(client.get("/api/v1/traffic/series?last_s=0"), 422)


# --- the whole ----------------------------------------------------------------------------------------------------


def test_health_and_openapi(client):
    assert client.get("/healthz").json() == {"status": "ok"}
    ready = client.get("/readyz").json()
    assert (ready["ready"], ready["missing"]) == (True, [])
    assert ready["checks"]["perception"] == "w1"
    schema = client.get("/openapi.json").json()
    assert "/api/v1/missions/{id}/cancel" in schema["paths"]
    for path, methods in schema["paths"].items():
        for operation in methods.values():
            assert "application/problem+json" in operation["responses"]["default"]["content"], path
    for name in (
        "Mission",
        "Camera",
        "Robot",
        "Object",
        "Floor",
        "Worker",
        "NodeTraffic",
        "SourceTraffic",
        "MissionPlan",
    ):
        assert {"last_seen", "stale"} <= set(schema["components"]["schemas"][name]["properties"]), name


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/v1/nothing", 404),
        ("DELETE", "/api/v1/missions", 405),
        ("GET", "/redoc", 404),
        ("GET", "/docs/other.js", 404),
        ("GET", "/api/v1/cameras/", 404),
    ],
)
def test_addresses_that_arent_there(client, method, path, status):
    problem(client.request(method, path), status)


def test_the_documentation_needs_nothing_from_elsewhere(client):
    answer = client.get("/docs")
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    links = re.findall(r'(?:src|href)="([^"]+)"', answer.text)
    assert len(links) == 3
    for link in links:
        assert client.get(link).status_code == 200, link
    assert "https://" not in answer.text
    assert '"validatorUrl": null' in answer.text


def test_a_map_that_grew_keeps_its_place_in_the_world(client, building):
    building.grid = Grid(-3.0, -2.0, 0.5, 12, 20)
    building.put_revision()
    try:
        until(
            lambda: (
                client.get("/api/v1/floors/0/layers/explored.png").headers["x-surveilnav-grid"] == "-3 -2 0.5 12 20"
            ),
            "the grid never grew",
        )
    finally:
        building.grid = Grid(-1.0, -2.0, 0.5, 12, 16)
        building.put_revision()


def test_services_that_are_kept_running(client, building):
    assert client.get("/api/v1/services").json() == {"items": [], "total": 0}
    up = building.node("cli", "up")
    states = [m.ServiceState("router", True), m.ServiceState("fusion", False, 2, 1_700_000_000_000_000_000, "SIGKILL")]
    publisher = up.publisher(contract.SERVICES, supervisor="up")
    until(lambda: publisher.matched)
    publisher.put(m.ServiceList(stamp_ns=clock_ns(), supervisor="up", services=states))
    router, fusion = until(lambda: client.get("/api/v1/services").json()["items"])
    assert (router["id"], router["running"], router["restarts"], router["restarted"]) == ("router", True, 0, None)
    assert (fusion["running"], fusion["restarts"], fusion["why"], fusion["stale"]) == (False, 2, "SIGKILL", False)
    assert fusion["restarted"] == "2023-11-14T22:13:20Z"


def test_metrics_are_what_prometheus_reads(client, building):
    building.put_sources()
    until(lambda: 'surveilnav_perception_up{worker="w1"} 1' in client.get("/metrics").text, "the worker isn't there")
    answer = client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=")
    assert 'surveilnav_camera_views_expected{camera="c1"} 13' in answer.text
    assert "surveilnav_ready 1" in answer.text
