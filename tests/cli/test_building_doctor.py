"""``surveilnav doctor --building building.yaml`` against streams, a robot's router and a gateway that are there, or aren't."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from email.utils import formatdate
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import surveilnav.cli.building_check.check as check
from surveilnav.bus.router import free_port, open_router
from surveilnav.cli.main import app
from surveilnav.cli.stream_probe import at_once, clock_offset_s
from tests import streams
from tests.robot_hardware import write_robot_file

NOWHERE = "http://127.0.0.1:9"
CAMERA = {
    "name": "lobby",
    "floor": "0",
    "position_m": [2, 1.5, 2.6],
    "yaw_deg": 90,
    "pitch_deg": -30,
    "lens": {"width_px": 320, "height_px": 240, "hfov_deg": 90},
}


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """An RTSP server with a room, and with a lens that is covered."""
    videos = tmp_path_factory.mktemp("videos")
    streams.write_looped_video(videos / "room.mp4", [streams.room(t) for t in range(5)], 120.0)
    streams.write_looped_video(videos / "dark.mp4", [np.zeros((240, 320, 3), np.uint8)] * 5, 120.0)
    with streams.rtsp_server(videos) as (at, _):
        yield at


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A building with a floor plan of 20 x 15 m, without cameras and robots."""
    cv2.imwrite(str(tmp_path / "plan.png"), np.full((300, 400), 255, np.uint8))
    text = "image: plan.png\nresolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    (tmp_path / "plan.yaml").write_text(text)
    write(tmp_path)
    return tmp_path


def write(folder: Path, *cameras: dict[str, Any], **building: Any) -> None:
    """Writes the building's files. ``cameras``: what differs from ``CAMERA``."""
    file = {"floors": {"0": {"z_m": 0.0}}, "cameras": [CAMERA | camera for camera in cameras]}
    (folder / "cameras.yaml").write_text(yaml.safe_dump(file))
    floors = {"0": {"plan": "plan.yaml"}}
    (folder / "building.yaml").write_text(yaml.safe_dump({"building": "hq", "floors": floors} | building))


def examined(folder: Path, *options: str) -> tuple[int, dict[str, dict[str, str]]]:
    """The exit code, and what was found, by what was looked at; perception's weights are left out."""
    arguments = ["doctor", "--building", str(folder / "building.yaml"), "--seconds", "1", "--url", NOWHERE, "--json"]
    done = CliRunner().invoke(app, [*arguments, *options])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    found = {f["what"]: f for f in json.loads(done.stdout)["findings"]}
    return done.exit_code, {what: f for what, f in found.items() if what not in ("models", "compact")}


def problems(found: dict[str, dict[str, str]]) -> dict[str, str]:
    return {what: f["detail"] for what, f in found.items() if f["level"] == "problem"}


# --- files ----------------------------------------------------------------------------------------------------------


def test_a_building_without_anything_on_the_network_has_nothing_to_mend(folder: Path) -> None:
    status, found = examined(folder)
    assert (status, problems(found)) == (0, {})
    assert found["floor 0, plan"]["detail"].endswith("x 0.0 to 20.0 m, y 0.0 to 15.0 m")
    assert found["running system"]["level"] == "note"
    assert "compose.building.yaml" in found["running system"]["remedy"]


@pytest.mark.parametrize(
    ("building", "what", "says"),
    [
        ({"cameras": "no.yaml"}, "no.yaml", "can't be read"),
        ({"robots": {"r1": "no.yaml"}}, "no.yaml", "can't be read"),
        ({"floors": {"2": {}}}, "building.yaml", "floor 2 isn't one of"),
        ({"floors": {"0": {"plan": "no.png"}}}, "floor 0, plan", "there is no file"),
        ({"floors": {"0": {"plan": "no.yaml"}}}, "floor 0, plan", "can't be read"),
        (
            {"floors": {"0": {"plan": "plan.yaml", "keepout": {"pit": [[50, 0], [51, 0], [51, 1]]}}}},
            "floor 0",
            "keepout 'pit' lies outside the floor plan",
        ),
        (
            {
                "floors": {
                    "0": {
                        "plan": "plan.yaml",
                        "nav2_map": "plan.yaml",
                        "T_building_map": {"x_m": 40, "y_m": 0, "yaw_deg": 0},
                    }
                }
            },
            "floor 0, Nav2's map",
            "100 % of its free floor lie outside the floor plan",
        ),
    ],
)
def test_a_mistake_in_the_files_is_named(folder: Path, building: dict[str, Any], what: str, says: str) -> None:
    write(folder, **building)
    status, found = examined(folder)
    assert status == 1
    (detail,) = [detail for name, detail in problems(found).items() if name.endswith(what)]
    assert says in detail


def test_a_building_file_that_is_not_there_is_a_line(tmp_path: Path) -> None:
    status, found = examined(tmp_path)
    assert (status, len(found)) == (1, 1)


def test_a_camera_with_a_mistake_is_named_and_the_others_are_looked_at(folder: Path, address: str) -> None:
    write(folder, {"stream": f"{address}/room.mp4"}, {"name": "bad", "stream": "usb:0", "floor": "x"})
    status, found = examined(folder)
    assert status == 1
    (told,) = problems(found).values()
    assert told.endswith("camera bad: floor: there is no floor 'x'; there are 0")
    assert found["camera lobby, stream"]["level"] == "ok"


def test_what_a_container_cannot_read_is_noted(folder: Path) -> None:
    folder.chmod(0o755)
    (folder / "building.yaml").chmod(0o644)
    (folder / "cameras.yaml").chmod(0o600)
    noted = {w: f["remedy"] for w, f in examined(folder)[1].items() if "another user" in f["detail"]}
    assert noted == {str(folder / "cameras.yaml"): f"chmod o+r {folder / 'cameras.yaml'}"}
    folder.chmod(0o700)
    assert examined(folder)[1][str(folder)]["remedy"] == f"chmod o+rx {folder}"


# --- cameras --------------------------------------------------------------------------------------------------------


def test_a_camera_that_is_as_described_is_ok(folder: Path, address: str) -> None:
    write(folder, {"stream": f"{address}/room.mp4"})
    status, found = examined(folder)
    assert (status, problems(found)) == (0, {})
    assert found["camera lobby, stream"]["detail"].startswith("320x240, ")
    assert "pictures a second" in found["camera lobby, stream"]["detail"]
    assert found["camera lobby, place"]["detail"].startswith("(2.00, 1.50) m, 2.60 m above floor 0")
    assert found["camera lobby"]["level"] == "note", "a container would look for the stream in itself"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("{address}/nothing.mp4", "the camera has no stream at the path /nothing.mp4"),
        ("{address}/dark.mp4", "its picture is black"),
        ("rtsp://127.0.0.1:9/x", "refuses connections"),
        ("rtsp://no-such-camera.invalid/x", "isn't known"),
        ("http://127.0.0.1:9/x.jpg", "can't be reached"),
        ("rtsp://u:${SOME_PASSWORD}@127.0.0.1:9/x", "SOME_PASSWORD isn't set"),
        ("nowhere", "there is no"),
    ],
)
def test_a_stream_that_brings_nothing_says_why(folder: Path, address: str, name: str, says: str) -> None:
    write(folder, {"stream": name.replace("{address}", address)})
    status, found = examined(folder)
    assert status == 1
    assert says in problems(found)["camera lobby, stream"]


def test_pictures_of_another_size_than_the_lens_are_a_problem(folder: Path, address: str) -> None:
    write(folder, {"stream": f"{address}/room.mp4", "lens": {"width_px": 640, "height_px": 480, "hfov_deg": 90}})
    told = problems(examined(folder)[1])["camera lobby, stream"]
    assert told == "its pictures have 320x240 pixels, but its lens is given for 640x480"


def test_passwords_come_from_the_file_beside(folder: Path, address: str) -> None:
    write(folder, {"stream": address.replace("127.0.0.1", "${LOBBY_PASSWORD}") + "/room.mp4"})
    (folder / "passwords.env").write_text("LOBBY_PASSWORD=127.0.0.1\n")
    assert problems(examined(folder)[1]) == {}


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ({"position_m": [0, 0, 2.5], "yaw_deg": 0, "pitch_deg": 0}, "it isn't calibrated yet"),
        ({"position_m": [50, 1.5, 2.6]}, "(50.00, 1.50) m lies outside the plan of floor 0"),
        ({"pitch_deg": 60}, "it sees no floor with pitch 60"),
    ],
)
def test_a_place_that_cannot_be_true_is_a_problem(folder: Path, camera: dict[str, Any], says: str) -> None:
    write(folder, {"stream": "rtsp://127.0.0.1:9/x"} | camera)
    status, found = examined(folder)
    assert status == 1
    assert says in problems(found)["camera lobby, place"]
    assert "surveilnav cameras calibrate lobby --plan" in found["camera lobby, place"]["remedy"]


def test_two_cameras_at_one_place_are_a_problem(folder: Path) -> None:
    write(folder, {"stream": "rtsp://127.0.0.1:9/x"}, {"name": "hall", "stream": "rtsp://127.0.0.1:9/x"})
    _, found = examined(folder)
    assert problems(found)["camera hall, place"] == "camera lobby has the same place and direction"
    assert found["camera lobby, place"]["level"] == "ok"


@contextmanager
def silent_server() -> Iterator[int]:
    """Takes connections and answers nothing; yields its port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken: list[socket.socket] = []

        def take() -> None:
            try:
                while True:
                    taken.append(server.accept()[0])
            except OSError:
                return

        threading.Thread(target=take, daemon=True).start()
        yield int(server.getsockname()[1])
        for connection in taken:
            connection.close()


@pytest.mark.timeout(90)
def test_nothing_that_is_silent_holds_up_the_rest(folder: Path, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cameras, a robot's router and a gateway that take connections and never answer."""
    monkeypatch.setattr(check, "deadline_s", lambda n_streams: 30.0)
    with silent_server() as port:
        silent = [{"name": f"c{i}", "stream": f"rtsp://127.0.0.1:{port}/1", "yaw_deg": 10 * i} for i in range(8)]
        write_robot_file(folder / "r1.yaml", f"tcp/127.0.0.1:{port}")
        write(folder, *silent, {"stream": f"{address}/room.mp4"}, robots={"r1": "r1.yaml"})
        status, found = examined(folder, "--url", f"http://127.0.0.1:{port}")
    assert status == 1
    told = problems(found)
    assert sum("doesn't answer" in detail for detail in told.values()) == 8, told
    assert found["camera lobby, stream"]["level"] == "ok"
    assert any(what.startswith("robot r1") for what in told)


def test_a_task_that_hangs_is_left_behind() -> None:
    hung = threading.Event()
    tasks = {"quick": lambda: 1, "slow": lambda: hung.wait(30.0) or 2}
    assert at_once(tasks, 0.3, lambda name: -1) == {"quick": 1, "slow": -1}
    hung.set()


@pytest.mark.parametrize("ahead_s", [0.0, 3600.0, -90.0])
def test_a_cameras_clock_is_known_by_the_date_of_its_answer(tmp_path: Path, ahead_s: float) -> None:
    import time

    date = formatdate(time.time() + ahead_s, usegmt=True)
    with streams.one_line_server(f"RTSP/1.0 401 Unauthorized\r\nCSeq: 1\r\nDate: {date}\r\n\r\n".encode()) as port:
        offset_s = clock_offset_s(f"rtsp://127.0.0.1:{port}/1", tmp_path)
    assert offset_s == pytest.approx(ahead_s, abs=2.0)
    assert clock_offset_s("usb:0", tmp_path) is None


# --- robots and the running system ----------------------------------------------------------------------------------


def test_a_robot_is_looked_at_part_by_part(folder: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    write_robot_file(folder / "r1.yaml", endpoint, floor="9")
    write_robot_file(folder / "r2.yaml", endpoint, floor_z_m=1.0)
    write(folder, robots={"r1": "r1.yaml", "r2": "r2.yaml"})
    with open_router(endpoint):
        status, found = examined(folder)
    assert status == 1
    told = problems(found)
    assert found["robot r1, router"]["level"] == "ok"
    assert "floor 9 isn't one of" in told["robot r1, floor"]
    assert told["robot r2, floor"] == "floor_z_m is 1, but floor 0 lies at 0 m"
    assert "nobody publishes /odom" in told["robot r1, odometry"]


def test_a_robots_router_that_is_not_there_is_a_line_without_the_innards_of_zenoh(folder: Path) -> None:
    write_robot_file(folder / "r1.yaml", f"tcp/127.0.0.1:{free_port()}")
    write(folder, robots={"r1": "r1.yaml"})
    told = problems(examined(folder)[1])
    assert "rmw_zenohd" in told["robot r1, router"]
    assert ".rs:" not in told["robot r1, router"]


def test_names_of_buildings_to_be_simulated_are_still_understood() -> None:
    done = CliRunner().invoke(app, ["doctor", "--building", "no_such_home", "--json"])
    found = {f["what"]: f["level"] for f in json.loads(done.stdout)["findings"]}
    assert (done.exit_code, found["building"]) == (1, "problem")


def test_people_see_a_line_for_each_part(folder: Path) -> None:
    done = CliRunner().invoke(app, ["doctor", "--building", str(folder / "building.yaml"), "--url", NOWHERE])
    marks = [line.split()[0] for line in done.stdout.splitlines()]
    assert set(marks) <= {"ok", "note", "problem"}
    assert len(marks) >= 4
