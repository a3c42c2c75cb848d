"""``surveilnav init``: what a person types, what a file of answers says, and which files come of it."""

from __future__ import annotations

import json
import os
import stat
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner, Result

import surveilnav.cli.building_setup.writing as writing
from surveilnav.building_file import load_building
from surveilnav.cameras_file import load_cameras
from surveilnav.cameras_file.passwords import passwords_in, without_secrets
from surveilnav.cameras_file.uncalibrated import is_uncalibrated
from surveilnav.cameras_file.urls import with_secrets
from surveilnav.cli.building_setup.answers import load_answers
from surveilnav.cli.main import app, main
from surveilnav.errors import ConfigError
from surveilnav.robot_file import load_robot
from tests import streams

ANSWERS: dict[str, Any] = {
    "building": "Headquarters: north",
    "floors": {
        "ground": {"plan": "plan.png", "plan_width_m": 20},
        "1": {"z_m": 3.5, "nav2_map": "map/first.yaml", "plan": "map/first.yaml"},
    },
    "cameras": [
        {
            "name": "lobby",
            "floor": "ground",
            "stream": "rtsp://10.0.0.5/1",
            "user": "view er",
            "password": "p@ss:/w%41d$",
        },
        {
            "name": "hall",
            "label": "Halle, Süd",
            "floor": "1",
            "stream": "http://10.0.0.6/snapshot.jpg?user=a&pwd=s3cret",
            "picture_px": "1280x720",
            "hfov_deg": 96,
            "position_m": [2, 1.5, 6],
            "yaw_deg": 90,
            "pitch_deg": -25,
        },
    ],
    "robots": {
        "r1": {"router": "10.0.0.7", "namespace": "/robot1", "floor": "1", "on_nav2_map": True},
        "r-2": {"router": "tcp/robot.example:7448", "nav2": False, "floor": "ground"},
    },
}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a floor plan, Nav2's map and a file of answers."""
    cv2.imwrite(str(tmp_path / "plan.png"), np.full((300, 400, 3), 255, np.uint8))
    (tmp_path / "map").mkdir()
    cv2.imwrite(str(tmp_path / "map" / "first.pgm"), np.full((80, 100), 254, np.uint8))
    (tmp_path / "map" / "first.yaml").write_text(
        "image: first.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    (tmp_path / "answers.yaml").write_text(yaml.safe_dump(ANSWERS, allow_unicode=True, sort_keys=False))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(*arguments: str, said: str = "") -> Result:
    return CliRunner().invoke(app, ["init", *arguments], input=said)


def from_answers(change: dict[str, Any] | None = None, *options: str) -> Result:
    Path("answers.yaml").write_text(yaml.safe_dump(ANSWERS | (change or {}), allow_unicode=True, sort_keys=False))
    return typed("hq", "--answers", "answers.yaml", "--offline", *options)


def files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


WRITTEN = [
    "building.yaml",
    "cameras.yaml",
    "compose.override.yaml",
    "maps/1.pgm",
    "maps/1.yaml",
    "passwords.env",
    "plans/ground.png",
    "plans/ground.yaml",
    "robots/r-2.yaml",
    "robots/r1.yaml",
]


def test_answers_become_files_that_every_reader_can_use(place: Path) -> None:
    done = from_answers()
    assert done.exit_code == 0, done.output
    assert files_in(place / "hq") == WRITTEN
    building = load_building(place / "hq" / "building.yaml")
    assert building.building == "Headquarters: north"
    assert building.floors["1"].plan == building.floors["1"].nav2_map == place / "hq" / "maps" / "1.yaml"
    cameras = load_cameras(building.cameras)
    assert (cameras.problems, list(cameras.cameras)) == ((), ["lobby", "hall"])
    hall = cameras.cameras["hall"]
    assert (hall.label, hall.position_m, hall.yaw_deg, hall.pitch_deg) == ("Halle, Süd", (2, 1.5, 6), 90, -25)
    assert (hall.lens.width_px, hall.lens.height_px, hall.lens.hfov_deg) == (1280, 720, 96)
    assert is_uncalibrated(cameras.cameras["lobby"], 0.0)
    robots = {name: load_robot(file) for name, file in building.robots.items()}
    assert [(r.router, r.namespace, r.drive, r.floor, r.floor_z_m) for r in robots.values()] == [
        ("tcp/10.0.0.7:7447", "/robot1", "waypoints", "1", 3.5),
        ("tcp/robot.example:7448", "", "actions", "ground", 0.0),
    ]
    T = robots["r1"].T_building_map
    assert T is not None
    assert T.model_dump() == {"x_m": 0, "y_m": 0, "yaw_deg": 0}, "the plan is the robot's own map"
    assert robots["r-2"].T_building_map is None


def test_passwords_stand_in_a_file_of_their_own_which_only_its_owner_reads(place: Path) -> None:
    before = os.umask(0o077)
    try:
        assert from_answers().exit_code == 0
    finally:
        os.umask(before)
    folder = place / "hq"
    folders = [folder, *(path for path in folder.rglob("*") if path.is_dir())]
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o755 for path in folders)
    assert stat.S_IMODE((folder / "passwords.env").stat().st_mode) == 0o600
    others = [path for path in folder.rglob("*") if path.is_file() and path.name != "passwords.env"]
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o644 for path in others), "containers run as another user"
    for path in others:
        for secret in (b"p@ss", b"p%40ss", b"s3cret"):
            assert secret not in path.read_bytes(), path
    cameras = load_cameras(folder / "cameras.yaml").cameras
    addresses = {name: with_secrets(camera.stream, passwords_in(folder)) for name, camera in cameras.items()}
    assert addresses == {
        "lobby": "rtsp://view%20er:p%40ss%3A%2Fw%2541d%24@10.0.0.5/1",
        "hall": "http://10.0.0.6/snapshot.jpg?user=a&pwd=s3cret",
    }


def test_the_plan_of_a_picture_gets_its_scale(place: Path) -> None:
    assert from_answers().exit_code == 0
    from surveilnav.camera_pose import load_floor_plan

    plan = load_floor_plan(place / "hq" / "plans" / "ground.yaml")
    assert (plan.resolution_m, plan.width_px, plan.floor) == (pytest.approx(0.05), 400, "ground")


def test_the_next_commands_are_those_that_are_needed(place: Path) -> None:
    done = from_answers({}, "--json")
    assert json.loads(done.stdout)["next"] == [
        "surveilnav doctor --building hq/building.yaml",
        "surveilnav cameras calibrate lobby --plan hq/plans/ground.yaml --fit-hfov --file hq/cameras.yaml",
        "surveilnav robots frame hq/robots/r-2.yaml --pair X,Y=X,Y ... --write",
        "docker compose -f compose.building.yaml -f hq/compose.override.yaml up --wait",
        "surveilnav where wheelchair",
    ]


def test_the_next_commands_begin_to_work(place: Path) -> None:
    """A camera whose place isn't known can be calibrated on the plan that was written."""
    assert from_answers().exit_code == 0
    from surveilnav.cli.calibration_page.session import Session

    session = Session("lobby", place / "hq/cameras.yaml", place / "hq/plans/ground.yaml", place / "hq/clicks.yaml")
    assert session.state()["plan"] == {"width_px": 400, "height_px": 300, "resolution_m": 0.05}
    session = Session("hall", place / "hq/cameras.yaml", place / "hq/maps/1.yaml", place / "hq/clicks.yaml")
    assert session.state()["floor"] == "1"


def test_nothing_is_replaced_without_force(place: Path) -> None:
    assert from_answers().exit_code == 0
    before = {name: (place / "hq" / name).read_bytes() for name in WRITTEN}
    for done in (from_answers({"building": "another"}), typed("hq", said="")):  # told before anything is asked
        assert isinstance(done.exception, ConfigError)
        assert "--force replaces them" in str(done.exception)
    assert {name: (place / "hq" / name).read_bytes() for name in WRITTEN} == before
    assert from_answers({"building": "another"}, "--force").exit_code == 0
    assert load_building(place / "hq" / "building.yaml").building == "another"


def test_a_robots_file_that_is_there_is_not_replaced_either(place: Path) -> None:
    (place / "hq" / "robots").mkdir(parents=True)
    (place / "hq" / "robots" / "r1.yaml").write_text("mine")
    done = from_answers()
    assert "robots/r1.yaml: there already" in str(done.exception)
    assert files_in(place / "hq") == ["robots/r1.yaml"]


@pytest.mark.parametrize("failing", [3, 8])
def test_an_interruption_leaves_nothing_half_written(
    place: Path, monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    n, make = 0, writing.tempfile.mkstemp

    def mkstemp(**options: Any) -> Any:
        nonlocal n
        n += 1
        if n == failing:
            raise KeyboardInterrupt
        return make(**options)

    monkeypatch.setattr(writing.tempfile, "mkstemp", mkstemp)
    assert from_answers().exit_code != 0
    assert not (place / "hq").exists()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"cameras": [{"name": "a", "floor": "x", "stream": "usb:0"}]},
            "camera a: there is no floor 'x'; there are ground, 1",
        ),
        ({"robots": {"r1": {"router": "a b", "floor": "1"}}}, "robots.r1.router: expected such as 10.0.0.7"),
        ({"robots": {"r1": {"floor": "1"}}}, "robots.r1.router: it is missing"),
        ({"floors": {"g": {"z_m": "high"}}}, r"line \d+: floors.g.z_m: expected a number"),
        ({"floors": {"g": {"plan": "plan.png"}}, "cameras": [], "robots": {}}, "floor g: plan_width_m is missing"),
        ({"floors": {"g": {"plan": "no.png"}}, "cameras": [], "robots": {}}, "there is no file no.png"),
        ({"floors": {}}, "floors: .*at least 1"),
        ({"kameras": []}, "kameras: Extra inputs"),
        ({"building": ""}, "building: expected 1 to 100 characters"),
        ({"cameras": [{"name": "a", "floor": "1", "stream": "ftp://x/y"}]}, "camera a, stream: expected rtsp://"),
        ({"cameras": [{"name": "a", "floor": "1", "stream": "rtsp://h:x/1"}]}, "camera a, stream: expected an address"),
        (
            {"cameras": [{"name": "a", "floor": "1", "stream": "usb:0", "hfov_deg": 190}]},
            "camera a: lens: a pinhole lens sees less than 170 degrees",
        ),
        (
            {"cameras": [{"name": "a", "floor": "1", "stream": "usb:0", "position_m": [0, 0, 1]}]},
            "camera a: position_m: the camera is -2.50 m above its floor",
        ),
        ({"cameras": [{"name": "a", "floor": "1", "stream": "usb:0"}] * 2}, "camera a: several cameras have this name"),
    ],
)
def test_a_mistake_in_the_answers_is_named_and_nothing_written(place: Path, change: dict[str, Any], says: str) -> None:
    done = from_answers(change)
    assert isinstance(done.exception, ConfigError), done.output
    import re

    assert re.search(says, str(done.exception)), done.exception
    assert not (place / "hq").exists()


def test_a_mistake_beside_a_password_does_not_tell_it(place: Path) -> None:
    change = {"cameras": [{"name": "a", "floor": "1", "stream": "rtsp://u:geheim@h:x/1", "password": ["geheim"]}]}
    assert "geheim" not in str(from_answers(change).exception)
    del change["cameras"][0]["password"]
    assert "geheim" not in str(from_answers(change).exception)


# --- asked in a terminal --------------------------------------------------------------------------------------------

#: What a person types; the second of two is what is asked for again.
TYPED = """\
Headquarters

low
0
nowhere.png
plan.png
wide
20

1
3.5

map/first.yaml


lob by
lobby

ftp://10.0.0.5
rtsp://viewer:p%40ss@10.0.0.5/1
huge
1920 x 1080
perhaps

200
96
2, 1.5
2, 1.5, 2.6
90

hall
upstairs
1
http://10.0.0.6/snapshot.jpg






r1
10.0.0.7


yes
1


"""


def test_a_wrong_answer_is_asked_again_with_what_was_expected(place: Path) -> None:
    done = typed("hq", "--offline", said=TYPED)
    assert done.exit_code == 0, done.output
    for expected in (
        "Error: expected a number; one floor of the building has 0",
        "Error: there is no file nowhere.png",
        "Error: expected a number of metres",
        "Error: expected letters, digits, '_', '.', '-', at most 64",
        "Error: camera lobby, stream: expected rtsp://10.0.0.5/stream1, http://",
        "Error: expected width and height in pixels, such as 1920x1080",
        "Error: expected yes or no",
        "Error: expected less than 170 degrees",
        "Error: expected three numbers, such as 2.0, 1.5, 2.6",
        "Error: expected one of ground, 1",
    ):
        assert expected in done.output
    building = load_building(place / "hq" / "building.yaml")
    cameras = load_cameras(building.cameras).cameras
    assert cameras["lobby"].position_m == (2, 1.5, 2.6)
    assert (cameras["lobby"].yaw_deg, cameras["lobby"].pitch_deg, cameras["lobby"].floor) == (90, -30, "ground")
    assert cameras["lobby"].stream == "rtsp://viewer:${LOBBY_PASSWORD}@10.0.0.5/1"
    assert is_uncalibrated(cameras["hall"], 3.5)
    assert load_robot(building.robots["r1"]).T_building_map is not None
    assert "surveilnav cameras calibrate hall --plan hq/maps/1.yaml" in done.stdout


@pytest.mark.parametrize("n_lines", [0, 1, 8, 20])
def test_an_input_that_ends_early_writes_nothing(place: Path, n_lines: int) -> None:
    done = typed("hq", said="".join(f"{line}\n" for line in TYPED.splitlines()[:n_lines]))
    assert "--answers FILE" in str(done.exception)
    assert not (place / "hq").exists()


def test_a_command_ends_with_a_line_and_no_traceback(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["surveilnav", "init", "hq", "--answers", "nowhere.yaml"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert capsys.readouterr().err.startswith("error: the file of answers can't be read")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_named(place: Path) -> None:
    place.chmod(0o555)
    assert isinstance(from_answers().exception, OSError)


# --- streams and addresses ------------------------------------------------------------------------------------------


def test_the_size_of_pictures_comes_from_the_stream(place: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    videos = tmp_path_factory.mktemp("videos")
    streams.write_looped_video(videos / "lobby.mp4", [streams.room(t, (480, 320)) for t in range(5)], 60.0)
    with streams.rtsp_server(videos) as (address, _):
        cameras = [
            {"name": "lobby", "floor": "1", "stream": f"{address}/lobby.mp4"},
            {"name": "gone", "floor": "1", "stream": f"rtsp://127.0.0.1:{streams.free_port()}/1"},
        ]
        Path("answers.yaml").write_text(yaml.safe_dump(ANSWERS | {"cameras": cameras}, sort_keys=False))
        done = typed("hq", "--answers", "answers.yaml")
    assert done.exit_code == 0, done.output
    assert "camera gone: 127.0.0.1" in done.stderr
    assert "refuses connections" in done.stderr
    read = load_cameras(place / "hq" / "cameras.yaml").cameras
    sizes = {name: (camera.lens.width_px, camera.lens.height_px) for name, camera in read.items()}
    assert sizes == {"lobby": (480, 320), "gone": (1920, 1080)}


@pytest.mark.parametrize(
    ("address", "stands_there", "secrets"),
    [
        ("rtsp://10.0.0.5/1", "rtsp://10.0.0.5/1", {}),
        ("rtsp://u@10.0.0.5/1", "rtsp://u@10.0.0.5/1", {}),
        ("rtsp://u:p@[::1]:554/1", "rtsp://u:${A_B_PASSWORD}@[::1]:554/1", {"A_B_PASSWORD": "p"}),
        ("rtsp://u:p@q@host/1", "rtsp://u:${A_B_PASSWORD}@host/1", {"A_B_PASSWORD": "p%40q"}),
        ("rtsp://u:${MY}@host/1", "rtsp://u:${MY}@host/1", {}),
        ("http://h/x?Password=p&n=1", "http://h/x?Password=${A_B_QUERY_PASSWORD}&n=1", {"A_B_QUERY_PASSWORD": "p"}),
        ("usb:0", "usb:0", {}),
        ("pictures", "pictures", {}),
    ],
)
def test_an_address_gives_up_its_password(address: str, stands_there: str, secrets: dict[str, str]) -> None:
    assert without_secrets(address, "a-b") == (stands_there, secrets)


@pytest.mark.parametrize("address", ["rtsp://u:p/q@host/1", "rtsp:///1", "rtsp://u:p@/1", "rtsp://h:x/1"])
def test_an_address_that_cannot_be_told_apart_is_refused_without_showing_it(address: str) -> None:
    with pytest.raises(ValueError, match="expected an address") as refused:
        without_secrets(address, "a")
    assert "p/q" not in str(refused.value)


def test_passwords_of_cameras_with_alike_names_are_kept_apart(place: Path) -> None:
    cameras = [
        {"name": name, "floor": "1", "stream": f"rtsp://u:{password}@h/1"}
        for name, password in (("a-b", "one"), ("a.b", "two"), ("a_b", "one"))
    ]
    assert from_answers({"cameras": cameras}).exit_code == 0
    read = load_cameras(place / "hq" / "cameras.yaml").cameras
    known = passwords_in(place / "hq")
    assert [with_secrets(camera.stream, known) for camera in read.values()] == [c["stream"] for c in cameras]


def test_a_passwords_file_is_read_as_compose_reads_it(tmp_path: Path) -> None:
    (tmp_path / "passwords.env").write_text("# a comment\nA=1=2\nexport B = 'x y'\n\nnothing\nC=\n")
    assert passwords_in(tmp_path) == {"A": "1=2", "B": "x y", "C": ""}
    assert passwords_in(tmp_path / "nowhere") == {}


def test_the_answers_of_the_manual_are_understood(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs/use/your-building.md").read_text(encoding="utf-8")
    block = next(block for block in page.split("```") if block.startswith("yaml\nbuilding:"))
    (tmp_path / "answers.yaml").write_text(block.removeprefix("yaml\n"))
    assert load_answers(tmp_path / "answers.yaml").robots
