"""The calibration page's addresses: what they answer, what they write, and whom they refuse."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from starlette.testclient import TestClient

from surveilnav.camera_pose import load_clicks, load_floor_plan
from surveilnav.cameras_file import load_cameras
from surveilnav.cli.calibration_page.app import create_app
from surveilnav.cli.calibration_page.session import Session
from surveilnav.errors import ConfigError
from tests.drawn_room import FLOOR_Z_M, LANDMARKS, T_WORLD_CAMERA, pixels_of, write_room

ORIGIN = "http://127.0.0.1:8765"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    write_room(tmp_path)
    return tmp_path


def session(room: Path, **more: Any) -> Session:
    files = {"cameras_file": room / "cameras.yaml", "plan_file": room / "map.yaml", "clicks_file": room / "c.yaml"}
    return Session("lobby", **(files | more))


def client(room: Path, **more: Any) -> TestClient:
    return TestClient(create_app(session(room, **more), "secret"), base_url=f"{ORIGIN}/secret/")


def pairs(room: Path, n: int = len(LANDMARKS)) -> dict[str, Any]:
    places = np.array(LANDMARKS[:n]).reshape(-1, 3)
    on_plan = load_floor_plan(room / "map.yaml").pixels_of(places)
    points = [
        {"px": list(px), "plan_px": list(plan_px), "z_m": z}
        for px, plan_px, z in zip(pixels_of(places), on_plan, places[:, 2], strict=True)
    ]
    return {"points": points, "fit_hfov": False}


def test_the_page_gets_all_its_files(room: Path) -> None:
    asked = client(room)
    page = asked.get("")
    assert page.headers["content-type"].startswith("text/html")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert page.headers["referrer-policy"] == "no-referrer"
    todo, seen = [part.split('"')[0] for part in page.text.split('="static/')[1:]], set()
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        answer = asked.get(f"static/{name}")
        assert answer.status_code == 200, name
        if name.endswith(".js"):  # and what it imports, relative to itself
            parts = [line.split('from "')[1].split('"')[0] for line in answer.text.splitlines() if ' from "' in line]
            todo += [str(Path("/", name).parent.joinpath(part).resolve())[1:] for part in parts]
    assert {
        "calibration/main.js",
        "style/tokens.css",
        "page/theme.js",
        "vendor/htm-preact-standalone.module.js",
    } <= seen


def test_picture_and_plan(room: Path) -> None:
    asked = client(room)
    state = asked.get("state").json()
    assert (state["camera"], state["label"], state["floor"]) == ("lobby", "Lobby, by the stairs", "first")
    assert (state["width_px"], state["height_px"], state["from_stream"]) == (1280, 960, True)
    assert state["plan"] == {"width_px": 450, "height_px": 350, "resolution_m": 0.02}
    plan = cv2.imdecode(np.frombuffer(asked.get("plan").content, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert (plan == cv2.imread(str(room / "map.png"), cv2.IMREAD_GRAYSCALE)).all()
    for method in ("GET", "POST"):
        answer = asked.request(method, "picture")
        assert answer.headers["content-type"] == "image/jpeg"
        assert cv2.imdecode(np.frombuffer(answer.content, np.uint8), 1).shape == (960, 1280, 3)


def test_a_new_picture_is_taken_when_it_is_asked_for(room: Path) -> None:
    asked = client(room)
    first = asked.get("picture").content
    cv2.imwrite(str(room / "frames/1.png"), np.zeros((960, 1280, 3), np.uint8))
    assert asked.get("picture").content == first
    assert asked.post("picture").content != first


def test_zones_stay_black(room: Path) -> None:
    text = (room / "cameras.yaml").read_text()
    (room / "cameras.yaml").write_text(text + "    zones: [[[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]]\n")
    drawn = cv2.imdecode(np.frombuffer(client(room).get("picture").content, np.uint8), 1)
    assert drawn[:80, :110].max() < 10 < drawn[150:, 200:].min()


def test_the_pose_is_that_of_the_command(room: Path) -> None:
    found = client(room).put("solution", json=pairs(room)).json()["solution"]
    assert found["position_m"] == pytest.approx([0.2, 0.3, FLOOR_Z_M + 2.5], abs=2e-3)
    assert found["height_m"] == pytest.approx(2.5, abs=2e-3)
    assert (found["yaw_deg"], found["pitch_deg"], found["roll_deg"]) == pytest.approx((38, -22, 0), abs=0.02)
    assert [p["used"] for p in found["points"]] == [True] * len(LANDMARKS)
    assert np.hypot(*found["position_sigmas_m"][:2]) <= found["position_sigma_m"] < 0.1
    assert math.hypot(*found["angle_sigmas_deg"]) == pytest.approx(found["angle_sigma_deg"], rel=0.2)
    assert found["predicted_px"] == pytest.approx(pixels_of(np.array(LANDMARKS)), abs=0.5)
    plan = load_floor_plan(room / "map.yaml")
    assert found["place_px"] == pytest.approx(plan.pixels_of(np.array([0.2, 0.3])), abs=0.2)


def test_the_plan_is_drawn_where_the_camera_sees_it(room: Path) -> None:
    """The foot of the far wall, and a crossing of the grid, lie on a line; the view's outline is on the plan."""
    found = client(room).put("solution", json=pairs(room)).json()["solution"]
    lines = {name: np.concatenate([dense(line) for line in found[name]]) for name in ("walls", "grid")}
    for name, at in (
        ("walls", (7.0, 3.5, 0.0)),
        ("walls", (4.6, 2.0, 0.0)),
        ("grid", (3.0, 2.0, 0.0)),
        ("grid", (5.0, 3.3, 0.0)),
    ):
        pixel = pixels_of(np.array([at]))[0]
        assert np.linalg.norm(lines[name] - pixel, axis=1).min() < 6, (name, at)
    off = pixels_of(np.array([(3.5, 2.5, 0.0)]))[0]
    assert all(np.linalg.norm(line - off, axis=1).min() > 20 for line in lines.values())
    inside = cv2.pointPolygonTest(np.array(found["view_px"], np.float32), [200.0, 200.0], False)
    outside = cv2.pointPolygonTest(np.array(found["view_px"], np.float32), [60.0, 150.0], False)
    assert (inside, outside) == (1, -1)


def dense(line: list[list[float]]) -> np.ndarray:
    ends = np.array(line)
    return np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in pairwise(ends)])


def test_a_point_that_contradicts_the_others_is_named(room: Path) -> None:
    body = pairs(room)
    body["points"][6]["plan_px"][0] += 30
    found = client(room).put("solution", json=body).json()["solution"]
    assert [i for i, point in enumerate(found["points"]) if not point["used"]] == [6]
    assert found["points"][6]["residual_m"] > 0.3


@pytest.mark.parametrize(
    ("change", "message", "points"),
    [
        (lambda b: b["points"].clear(), "a pose needs at least 4 points, and is good from 6 on; got 0", []),
        (lambda b: b.update(points=b["points"][:3]), "got 3", []),
        (
            lambda b: [p.update(plan_px=[10.0 + 3 * i, 20.0 + i], z_m=0) for i, p in enumerate(b["points"])],
            "on one line",
            [],
        ),
        (
            lambda b: [p["plan_px"].__setitem__(1, 349 - p["plan_px"][1]) for p in b["points"]],
            "2.5 m below the floor",
            [],
        ),
        (lambda b: b["points"][1].update(px=[2000.0, 5.0]), "point 2 at (2000, 5) lies outside the picture", [2]),
        (lambda b: b.update(points=b["points"][:5], fit_hfov=True), "to fit the field of view takes at least 6", []),
    ],
    ids=["none", "three", "one line", "mirrored", "outside", "field of view"],
)
def test_without_a_pose_the_solver_says_why(room: Path, change: Any, message: str, points: list[int]) -> None:
    body = pairs(room)
    change(body)
    answer = client(room).put("solution", json=body)
    assert answer.status_code == 200
    problem = answer.json()["problem"]
    assert message in problem["message"]
    assert problem["points"] == points


def test_points_survive_a_reload(room: Path) -> None:
    asked, body = client(room), pairs(room, 5) | {"fit_hfov": True}
    asked.put("solution", json=body)
    state = asked.get("state").json()
    assert {"points": state["points"], "fit_hfov": state["fit_hfov"]} == body


def test_saving_writes_the_pose_and_keeps_comments(room: Path) -> None:
    before = (room / "cameras.yaml").read_text().splitlines()
    answer = client(room).post("pose", json=pairs(room))
    assert answer.status_code == 200
    assert "lobby has its new place: position_m [0.200, 0.300, 6.000], yaw_deg 38.0" in answer.json()["message"]
    after = (room / "cameras.yaml").read_text().splitlines()
    assert [line for line in after if line in before] == [line for line in before if "guessed" not in line]
    assert sum("# guessed" in line for line in after) == 2
    assert load_cameras(room / "cameras.yaml").cameras["lobby"].pose() == pytest.approx(T_WORLD_CAMERA, abs=2e-3)


def test_saved_clicks_are_read_by_command_and_page(room: Path) -> None:
    body = pairs(room)
    body["points"][9]["plan_px"] = [-40.0, 20.5]  # not on the plan's picture: written in metres
    assert client(room).post("clicks", json=body).json()["message"].endswith("c.yaml: 10 points written")
    clicks = load_clicks(room / "c.yaml")
    assert (clicks.camera, clicks.plan is not None) == ("lobby", True)
    assert clicks.pixels == pytest.approx(np.array([p["px"] for p in body["points"]]), abs=0.006)
    assert clicks.p_floor[:9] == pytest.approx(np.array(LANDMARKS[:9]), abs=2e-4)
    assert clicks.p_floor[9, :2] == pytest.approx([-1.79, 5.58], abs=1e-3)
    again = client(room).get("state").json()["points"]
    for old, new in zip(body["points"], again, strict=True):
        assert new["px"] == pytest.approx(old["px"], abs=0.006)
        assert new["plan_px"] == pytest.approx(old["plan_px"], abs=0.006)
        assert new["z_m"] == old["z_m"]


@pytest.mark.parametrize(
    ("address", "body", "status", "message"),
    [
        ("pose", {"points": []}, 409, "a pose needs at least 4 points"),
        ("clicks", {"points": []}, 409, "there is no point to save yet"),
        ("pose", {"points": [{"px": [1, 2]}]}, 422, "points.0.plan_px: Field required"),
        ("clicks", {"points": [], "file": "/etc/passwd"}, 422, "file: Extra inputs are not permitted"),
        ("clicks", {"points": [{"px": [1, 2], "plan_px": [1, 2], "z_m": 99}]}, 422, "less than or equal to 50"),
    ],
)
def test_what_cannot_be_saved_is_refused(room: Path, address: str, body: Any, status: int, message: str) -> None:
    before = sorted(room.iterdir()), (room / "cameras.yaml").read_text()
    answer = client(room).post(address, json=body)
    assert answer.status_code == status
    assert message in answer.json()["message"]
    assert (sorted(room.iterdir()), (room / "cameras.yaml").read_text()) == before


def test_a_mistake_that_comes_later_is_a_message(room: Path) -> None:
    asked = client(room)
    (room / "cameras.yaml").write_text("cameras: [")
    assert "isn't YAML" in asked.get("state").json()["message"]
    assert "isn't YAML" in asked.put("solution", json=pairs(room)).json()["problem"]["message"]
    assert asked.post("pose", json=pairs(room)).status_code == 409
    (room / "map.png").unlink()
    assert asked.get("plan").status_code == 409


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("stream: frames", "stream: gone", "the stream of lobby gives no picture"),
        (
            "width_px: 1280",
            "width_px: 1920",
            "the picture has 1280 x 960 pixels, but the camera's lens is given for 1920 x 960",
        ),
    ],
)
def test_a_stream_without_a_picture_is_a_message(room: Path, old: str, new: str, message: str) -> None:
    text = (room / "cameras.yaml").read_text()
    (room / "cameras.yaml").write_text(text.replace(old, new))
    asked = client(room)
    answer = asked.get("picture")
    assert (answer.status_code, message in answer.json()["message"]) == (409, True)
    (room / "cameras.yaml").write_text(text)  # what is corrected counts at once
    assert asked.get("picture").status_code == 200


@pytest.mark.parametrize(
    ("file", "old", "new", "more", "message"),
    [
        ("map.yaml", "resolution: 0.02", "", {}, "resolution is missing"),
        ("map.yaml", "map.png", "gone.png", {}, "there is no file"),
        ("map.yaml", "image", "floor: ground\nimage", {}, "the plan shows floor 'ground', but camera lobby is on"),
        ("cameras.yaml", "name: lobby", "name: hall", {}, "there is no camera 'lobby'; there are hall"),
        ("cameras.yaml", "hfov_deg: ", "focal_px: [900, 900] # ", {"fit_hfov": True}, "isn't YAML"),
        ("map.yaml", "image", "image", {"picture_file": Path("none.png")}, "--picture none.png: there is no such file"),
    ],
)
def test_a_mistake_at_the_start_ends_the_command(
    room: Path, file: str, old: str, new: str, more: dict[str, Any], message: str
) -> None:
    text = (room / file).read_text()
    assert old in text
    (room / file).write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=message.replace("(", r"\(")):
        session(room, **more)


def test_clicks_of_another_camera_are_not_taken_up(room: Path) -> None:
    (room / "c.yaml").write_text("camera: hall\npoints: [{px: [1, 2], xy_m: [1, 2]}]\n")
    with pytest.raises(ConfigError, match="clicks of camera 'hall', not of 'lobby'"):
        session(room)


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/secret/state", {}, 200),
        ("/secret/state", {"Host": "localhost:8765"}, 200),
        ("/secret/state", {"Host": "evil.example"}, 421),
        ("/secret/state", {"Host": ""}, 421),
        ("/secret/state", {"Origin": "http://127.0.0.1:8765"}, 200),
        ("/secret/state", {"Origin": "https://evil.example"}, 403),
        ("/secret/state", {"Origin": "null"}, 403),
        ("/secret/state", {"Content-Length": "9999999"}, 413),
        ("/secret/state", {"Transfer-Encoding": "chunked"}, 413),
        ("/state", {}, 404),
        ("/", {}, 404),
        ("/guess/state", {}, 404),
        ("/secret/static/../page.html", {}, 404),
        ("/secret/static/page/app.js", {}, 404),
    ],
)
def test_only_who_knows_the_address_is_answered(room: Path, path: str, headers: dict[str, str], status: int) -> None:
    answer = TestClient(create_app(session(room), "secret"), base_url=ORIGIN).get(path, headers=headers)
    assert answer.status_code == status
    assert answer.headers["cache-control"] == "no-store"
    if status != 200:
        assert json.loads(answer.content)["message"]
