"""``surveilnav cameras calibrate``, as it is typed."""

from __future__ import annotations

import json
import math
import socket
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from surveilnav.cameras_file import load_cameras
from surveilnav.cli.main import main
from surveilnav.geometry import camera_pose
from tests.clicked_points import LENS, scene

T = camera_pose((1.0, 2.0, 6.0), math.radians(30), math.radians(-25))  # 2.5 m above a floor at 3.5 m
CAMERAS = f"""\
# the first floor
floors: {{first: {{z_m: 3.5}}}}
cameras:
  - name: lobby  # by the door
    floor: first
    stream: frames
    position_m: [0, 0, 6]   # guessed
    yaw_deg: 0              # guessed
    lens: {{width_px: 1280, height_px: 960, hfov_deg: {math.degrees(LENS.pinhole.hfov_rad)}}}
    zones:
      - [[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of a camera, nine clicks and a plan; the camera's stream is a folder of pictures."""
    T_above_floor = T.copy()
    T_above_floor[2, 3] -= 3.5
    seen = scene(np.random.default_rng(0), 9, True, T_world_camera=T_above_floor, margin_px=130)
    points = [
        f"  - {{px: [{u:.4f}, {v:.4f}], xy_m: [{x:.5f}, {y:.5f}], z_m: {z}}}"
        for (u, v), (x, y, z) in zip(seen.pixels, seen.p_world, strict=True)
    ]
    (tmp_path / "clicks.yaml").write_text("\n".join(["camera: lobby", "plan: map.yaml", "points:", *points]) + "\n")
    (tmp_path / "cameras.yaml").write_text(CAMERAS)
    (tmp_path / "map.yaml").write_text("image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\n")
    cv2.imwrite(str(tmp_path / "map.png"), np.full((40, 40), 255, np.uint8))
    (tmp_path / "frames").mkdir()
    for name in ("frame.png", "frames/1.png"):
        cv2.imwrite(str(tmp_path / name), np.full((960, 1280, 3), 90, np.uint8))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(monkeypatch: pytest.MonkeyPatch, *options: str) -> int:
    return command(monkeypatch, "--clicks", "clicks.yaml", *options)


def command(monkeypatch: pytest.MonkeyPatch, *options: str) -> int:
    monkeypatch.setattr(sys, "argv", ["surveilnav", "cameras", "calibrate", "lobby", *options])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_the_pose_is_printed(place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert typed(monkeypatch) == 0
    out = capsys.readouterr().out
    assert "point  9 (line 12):   0.0 px,   0.0 cm off" in out
    assert "position 1.00, 2.00 m, 2.50 m above the floor; ± 0.0" in out
    assert "yaw 30.0, pitch -25.0, roll" in out
    assert "position_m: [1.000, 2.000, 6.000]\nyaw_deg: 30.00\npitch_deg: -25.00\nroll_deg: " in out
    assert (place / "cameras.yaml").read_text() == CAMERAS


def test_write_changes_the_pose_and_nothing_else(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert typed(monkeypatch, "--write") == 0
    lines = (place / "cameras.yaml").read_text().splitlines()
    before = CAMERAS.splitlines()
    assert [line for line in lines if line in before] == [b for b in before if "guessed" not in b]
    assert sum("# guessed" in line for line in lines) == 2
    assert load_cameras(place / "cameras.yaml").cameras["lobby"].pose() == pytest.approx(T, abs=2e-3)


def test_programs_get_one_object(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert typed(monkeypatch, "--json", "--fit-hfov", "--write") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["position_m"] == pytest.approx([1, 2, 6], abs=5e-3)
    assert told["hfov_deg"] == pytest.approx(math.degrees(LENS.pinhole.hfov_rad), abs=0.05)
    assert [p["used"] for p in told["points"]] == [True] * 9
    assert told["points"][0]["line"] == 4
    assert told["written"] is True
    lens = load_cameras(place / "cameras.yaml").cameras["lobby"].lens
    assert lens.hfov_deg == pytest.approx(told["hfov_deg"], abs=0.01)


@pytest.mark.parametrize("picture", [["--picture", "frame.png"], []], ids=["a file", "the stream"])
def test_the_overlay_shows_the_grid_but_no_zone(
    place: Path, monkeypatch: pytest.MonkeyPatch, picture: list[str]
) -> None:
    assert typed(monkeypatch, "--overlay", "out.png", *picture) == 0
    drawn = cv2.imread(str(place / "out.png"))
    assert drawn.shape == (960, 1280, 3)
    assert (drawn[400:] != 90).any()
    assert not drawn[:90, :120].any()


def test_a_wrong_click_is_named(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clicks = (place / "clicks.yaml").read_text().splitlines()
    u = float(clicks[5].split("[")[1].split(",")[0])
    clicks[5] = clicks[5].replace(f"[{u:.4f},", f"[{u + 110:.4f},")
    (place / "clicks.yaml").write_text("\n".join(clicks))
    assert typed(monkeypatch) == 0
    assert next(line for line in capsys.readouterr().out.splitlines() if "left out" in line).startswith(
        "point  3 (line 6): 110."
    )


@pytest.mark.parametrize(
    ("file", "old", "new", "options", "message"),
    [
        ("clicks.yaml", "camera: lobby", "camera: hall", [], "these are clicks of camera 'hall', not of 'lobby'"),
        ("clicks.yaml", "xy_m", "xy", [], "line 4: point 1"),
        (
            "map.yaml",
            "origin",
            "floor: ground\norigin",
            [],
            "the plan shows floor 'ground', but camera lobby is on floor 'first'",
        ),
        ("map.yaml", "resolution: 0.1", "", [], "resolution is missing"),
        ("cameras.yaml", "name: lobby", "name: hall", [], "there is no camera 'lobby'; there are hall"),
        (
            "cameras.yaml",
            "    position_m: [0, 0, 6]",
            "   ",
            [],
            "Until it is calibrated, write `position_m: [0, 0, 2.5]`",
        ),
        ("cameras.yaml", "hfov_deg: ", "focal_px: [900, 900] #", ["--fit-hfov"], "isn't YAML"),
        ("cameras.yaml", "z_m: 3.5", "z_m: 4.5", ["--file", "none.yaml"], "the file of cameras can't be read"),
        (
            "frame.png",
            "",
            "",
            ["--overlay", "out.png", "--picture", "none.png"],
            "--picture none.png: there is no such file",
        ),
        ("frame.png", "", "", ["--overlay", "out.png", "--picture", "map.yaml"], "it isn't a picture"),
        ("frame.png", "", "", ["--overlay", "out.png", "--picture", "map.png"], "the picture has 40 x 40 pixels, but"),
        ("frame.png", "", "", ["--overlay", "no/out.png", "--picture", "frame.png"], "does its folder exist?"),
        ("frame.png", "", "", ["--overlay", "out.doc", "--picture", "frame.png"], "ends with .jpg or .png"),
        (
            "cameras.yaml",
            "stream: frames",
            "stream: gone",
            ["--overlay", "out.png"],
            "the stream of lobby gives no picture",
        ),
        ("cameras.yaml", "stream: frames", "stream: ${GONE}", ["--overlay", "out.png"], "variable GONE isn't set"),
    ],
)
def test_a_mistake_is_one_message(
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    file: str,
    old: str,
    new: str,
    options: list[str],
    message: str,
) -> None:
    if old:
        text = (place / file).read_text()
        assert old in text
        (place / file).write_text(text.replace(old, new))
    assert typed(monkeypatch, *options) == 1
    err = capsys.readouterr().err
    assert "error: " in err
    assert message in err.replace("\n", " ")
    assert "Traceback" not in err


def test_a_lens_from_a_calibration_keeps_its_focal_length(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = CAMERAS.replace(f"hfov_deg: {math.degrees(LENS.pinhole.hfov_rad)}", "focal_px: [900, 900]")
    (place / "cameras.yaml").write_text(text)
    assert typed(monkeypatch) == 0
    assert typed(monkeypatch, "--fit-hfov") == 1
    assert "--fit-hfov is for a lens that is given by hfov_deg" in capsys.readouterr().err


def test_a_picture_without_an_overlay_is_mistyped(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert typed(monkeypatch, "--picture", "frame.png") == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "add --plan map.yaml to click points on a page, or --clicks FILE"),
        (["--plan", "map.yaml", "--write"], "leave out --plan"),
        (["--plan", "map.yaml", "--json"], "leave out --plan"),
        (["--plan", "map.yaml", "--overlay", "x.png"], "leave out --plan"),
        (["--clicks", "clicks.yaml", "--port", "8765"], "--port and --no-browser are the page's"),
        (["--clicks", "clicks.yaml", "--no-browser"], "--port and --no-browser are the page's"),
    ],
)
def test_options_of_page_and_file_are_not_mixed(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert command(monkeypatch, *options) == 2
    told = capsys.readouterr()
    assert message in told.err + told.out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--plan", "none.yaml"], "the file of a floor plan can't be read"),
        (["--plan", "map.yaml", "--picture", "map.png"], "the picture has 40 x 40 pixels, but"),
        (["--plan", "map.yaml", "--file", "none.yaml"], "the file of cameras can't be read"),
        (["--plan", "map.yaml", "--clicks", "map.yaml"], "camera: Field required"),
    ],
)
def test_a_mistake_ends_the_command_before_there_is_a_page(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert command(monkeypatch, *options) == 1
    assert message in capsys.readouterr().err.replace("\n", " ")


def test_a_port_that_is_taken_is_named(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert command(monkeypatch, "--plan", "map.yaml", "--port", str(port), "--no-browser") == 1
    assert f"--port {port}: " in capsys.readouterr().err
