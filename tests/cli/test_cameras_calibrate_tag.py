"""``surveilnav cameras calibrate-tag``, as it is typed: on a gateway over HTTP, with folders of rendered pictures as streams."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from surveilnav.camera_pose.tag import load_sightings, save_sightings, stops
from surveilnav.cameras_file import load_cameras
from surveilnav.cli.main import main
from surveilnav.geometry import Pinhole, base_pose, camera_pose, inverse
from surveilnav.geometry.lens import BrownConrady
from surveilnav.rest import examples
from tests.tag_scenes import random_stops, render_tag, scene_from_poses, tag_on_robot

LENS = BrownConrady(Pinhole.from_hfov(960, 540, math.radians(85.0)))
CAMERAS_AT = {"lobby": camera_pose((0, 0, 6.0), 0, -0.44), "hall": camera_pose((0, 1.5, 5.9), -0.3, -0.4)}
ON_ROBOT = tag_on_robot()
SIZE_M = 0.3
_LENS = "lens: {width_px: 960, height_px: 540, hfov_deg: 85}"
FILE = f"""\
floors: {{first: {{z_m: 3.5}}, second: {{z_m: 7}}}}
cameras:
  - {{name: lobby, floor: first, stream: lobby, position_m: [0, 0, 6], yaw_deg: 0, {_LENS}}}
  - {{name: hall, floor: first, stream: hall, position_m: [0, 0, 6], yaw_deg: 0, {_LENS}}}
  - {{name: attic, floor: second, stream: gone, position_m: [0, 0, 9], yaw_deg: 0, {_LENS}}}
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "cameras.yaml").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(monkeypatch: pytest.MonkeyPatch, *options: str) -> int:
    monkeypatch.setattr(sys, "argv", ["surveilnav", "cameras", *options])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def write_sightings(place: Path, n: int = 12) -> None:
    poses = random_stops(np.random.default_rng(0), n)
    below = {
        name: T - np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 3.5], [0, 0, 0, 0]]) for name, T in CAMERAS_AT.items()
    }
    scene = scene_from_poses(poses, below, dict.fromkeys(below, LENS), ON_ROBOT, SIZE_M)
    for stop in scene.sightings.stops:
        stop.floor = "first"
    save_sightings(place / "tag_sightings.yaml", scene.sightings)


def test_sightings_are_solved_offline_and_written(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sightings(place)
    assert typed(monkeypatch, "calibrate-tag", "--offline", "--write") == 0
    out = capsys.readouterr().out
    assert "attic: saw the tag at 0 stops: 5 are needed" in out
    assert (
        "the tag sits 0.12 m ahead of the robot's centre and 0.03 m to its left; it faces 0 degrees from ahead, 29 degrees"
        in out
    )
    assert "position 0.00, 1.50 m, 2.40 m above the floor; ± 0.0" in out
    written = load_cameras(place / "cameras.yaml").cameras
    for name, T in CAMERAS_AT.items():
        assert written[name].pose() == pytest.approx(T, abs=2e-3)
    assert written["attic"].position_m == (0, 0, 9)


def test_a_tag_that_was_measured_anew_moves_the_cameras(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sightings(place)
    assert typed(monkeypatch, "calibrate-tag", "--offline", "--tag-height", "0.6", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["cameras"]["lobby"]["position_m"] == pytest.approx([0, 0, 6.1], abs=2e-3)
    assert told["tag_on_robot_m"] == pytest.approx([0.12, 0.03, 0.6], abs=2e-3)
    assert told["written"] is False


def test_a_wrong_stop_is_named(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sightings(place)
    sightings = load_sightings(place / "tag_sightings.yaml")
    sightings.stops[2].x_m += 1.0
    save_sightings(place / "tag_sightings.yaml", sightings)
    assert typed(monkeypatch, "calibrate-tag", "--offline") == 0
    named = [line for line in capsys.readouterr().out.splitlines() if "left out" in line]
    assert named
    assert all(line.startswith("stop 3 (") for line in named)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--offline", "--sightings", "new.yaml"], "--tag-size and --tag-height must be given"),
        (["--offline", "--sightings", "new.yaml", "--tag-size", "0.16"], "so --tag-height must be given"),
        (["--offline", "--tag-id", "3"], "has sightings of tag 0, not of 3"),
        (["--offline", "--file", "none.yaml"], "the file of cameras can't be read"),
        (["--offline", "--sightings", "new.yaml", "--tag-size", "0.2", "--tag-height", "1"], "saw the tag at 0 stops"),
        (["--url", "http://127.0.0.1:9"], "gateway"),
    ],
)
def test_a_mistake_is_one_message(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    monkeypatch.setattr("surveilnav.cli.collecting_tag._LOST_S", 0.5)
    write_sightings(place)
    assert typed(monkeypatch, "calibrate-tag", *options) == 1
    err = capsys.readouterr().err
    assert "error: " in err
    assert message in err.replace("\n", " ")
    assert "Traceback" not in err


def test_sightings_of_a_floor_that_isnt_there_are_named_at_their_line(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sightings(place)
    (place / "cameras.yaml").write_text(FILE.replace("first", "ground"))
    assert typed(monkeypatch, "calibrate-tag", "--offline") == 1
    told = capsys.readouterr().err.replace("\n", " ")
    assert "line 3: this stop is on floor 'first', but the floors of cameras.yaml are ground, second" in told


def test_a_tag_is_drawn(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert typed(monkeypatch, "draw-tag", "tag.png", "--tag-id", "7") == 0
    assert cv2.imread("tag.png").shape == (1000, 1000, 3)
    assert typed(monkeypatch, "draw-tag", "tag.doc") == 1
    assert typed(monkeypatch, "draw-tag", "no/tag.png") == 1


# --- a running system ---------------------------------------------------------------------------------------------


class Building:
    """A robot that drives from stop to stop, a gateway that says where it is, and cameras that write pictures of it."""

    def __init__(self, folder: Path, poses: np.ndarray) -> None:
        self._folder, self._poses = folder, poses
        self._here, self._robots = poses[0], ["r1"]
        self._ended = threading.Event()
        for name in CAMERAS_AT:
            (folder / name).mkdir()
        building = self

        class Gateway(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                body = json.dumps({"items": building.robots(), "total": len(building._robots)}).encode()
                self.send_response(200)
                self.send_header("Content-Type", "application/json")
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Gateway)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self._threads = [threading.Thread(target=target) for target in (self._server.serve_forever, self._drive)]

    def robots(self) -> list[dict[str, object]]:
        x, y, yaw = (float(value) for value in self._here)
        moving = {"position_m": [x, y, 3.5], "yaw_rad": yaw, "floor": "first", "stale": False}
        return [examples.ROBOT | moving | {"id": id} for id in self._robots]

    def add_robot(self) -> None:
        self._robots.append("r2")

    def __enter__(self) -> Building:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._server.shutdown()
        for thread in self._threads:
            thread.join()
        self._server.server_close()

    def _drive(self) -> None:
        """Three seconds at each stop; at the end somebody presses Ctrl-C."""
        for pose in self._poses:
            pictures = {}
            for name, T in CAMERAS_AT.items():
                T_world_tag = base_pose((*pose[:2], 3.5), pose[2]) @ ON_ROBOT
                picture = render_tag(LENS, inverse(T) @ T_world_tag, SIZE_M)
                pictures[name] = cv2.imencode(".png", picture)[1].tobytes()
            self._here = pose
            until_s = time.monotonic() + 3.0
            while time.monotonic() < until_s:
                for name, data in pictures.items():
                    (self._folder / name / "next").write_bytes(data)
                    (self._folder / name / "next").rename(self._folder / name / "now.png")
                if self._ended.wait(0.1):
                    return
        os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stops, "STILL_S", 0.5)


@pytest.mark.usefixtures("quick")
def test_a_robot_drives_past_the_cameras(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = random_stops(np.random.default_rng(4), 7, reach_m=(2.0, 4.5))
    with Building(place, poses) as building:
        options = ["--tag-size", str(SIZE_M), "--tag-height", "0.5", "--url", building.url, "--write"]
        code = typed(monkeypatch, "calibrate-tag", *options)
    told = capsys.readouterr()
    assert code == 0, told.err
    assert "lobby: reading its stream" in told.err
    assert "attic" not in told.err  # another floor's
    assert "lobby: 2 of 5 stops" in told.err
    assert "cameras.yaml: lobby" in told.err
    kept = load_sightings(place / "tag_sightings.yaml")
    assert kept.count("lobby") >= 5
    pose = load_cameras(place / "cameras.yaml").cameras["lobby"].pose()
    assert pose == pytest.approx(CAMERAS_AT["lobby"], abs=0.06)


@pytest.mark.usefixtures("quick")
def test_of_several_robots_one_has_to_be_named(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with Building(place, random_stops(np.random.default_rng(4), 2)) as building:
        building.add_robot()
        options = ["--tag-size", str(SIZE_M), "--tag-height", "0.5", "--url", building.url]
        assert typed(monkeypatch, "calibrate-tag", *options) == 1
        assert "by --robot r1 or r2" in capsys.readouterr().err.replace("\n", " ")
        assert typed(monkeypatch, "calibrate-tag", *options, "--robot", "r3") == 1
        assert "there is no robot 'r3'; there are r1, r2" in capsys.readouterr().err.replace("\n", " ")
