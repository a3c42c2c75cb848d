from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from surveilnav.cameras_file import load_cameras
from surveilnav.cameras_file.edit import edited, write_camera
from surveilnav.errors import ConfigError

FILE = """\
# our building
floors:
  ground: {z_m: 0.0}
cameras:
  - name: lobby
    floor: ground
    stream: usb:0
    position_m: [0, 0, 2.5]   # guessed
    yaw_deg: 0          # guessed, too
    # what follows is from the data sheet
    lens: {width_px: 1280, height_px: 960, hfov_deg: 80}
  - {name: hall, floor: ground, stream: "usb:1", position_m: [1, 1, 2], yaw_deg: 5,
     lens: {width_px: 64, height_px: 64, hfov_deg: 80}}
"""
POSE = {"position_m": "[1.5, -2, 2.75]", "yaw_deg": "91.2", "pitch_deg": "-20", "roll_deg": "0.5"}


def test_values_are_replaced_or_added_and_all_else_stays() -> None:
    changed = edited(Path("cameras.yaml"), FILE, "lobby", POSE | {"lens.hfov_deg": "81.5"})
    expected = (
        FILE.replace("[0, 0, 2.5]   # g", "[1.5, -2, 2.75]   # g")
        .replace(
            "yaw_deg: 0          # guessed, too\n",
            "yaw_deg: 91.2          # guessed, too\n    pitch_deg: -20\n    roll_deg: 0.5\n",
        )
        .replace("960, hfov_deg: 80}", "960, hfov_deg: 81.5}")
    )
    assert changed == expected
    assert edited(Path("cameras.yaml"), changed, "lobby", POSE | {"lens.hfov_deg": "81.5"}) == expected


def test_a_camera_in_braces() -> None:
    changed = edited(Path("cameras.yaml"), FILE, "hall", POSE)
    assert "position_m: [1.5, -2, 2.75], yaw_deg: 91.2, pitch_deg: -20, roll_deg: 0.5,\n" in changed
    assert changed.splitlines()[:-2] == FILE.splitlines()[:-2]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\r\n"),
        ("lobby\n", "lobby # Süd, 大堂\n"),
        ("[0, 0, 2.5] ", "[0,\n      0, 2.5] "),
        ("# our", "\ufeff# our"),
    ],
    ids=["crlf", "unicode", "multiline", "bom"],
)
def test_other_writing(tmp_path: Path, old: str, new: str) -> None:
    path = tmp_path / "cameras.yaml"
    path.write_bytes(FILE.replace(old, new).encode())
    write_camera(path, "lobby", POSE)
    file = load_cameras(path)
    assert file.problems == ()
    lobby = file.cameras["lobby"]
    assert (lobby.position_m, lobby.yaw_deg, lobby.pitch_deg, lobby.roll_deg) == ((1.5, -2, 2.75), 91.2, -20, 0.5)
    text = path.read_bytes().decode()
    assert "# guessed, too" in text
    assert text.count("\r\n") in (0, text.count("\n"))


def test_the_file_keeps_its_mode_and_a_link_stays_a_link(tmp_path: Path) -> None:
    path, link = tmp_path / "real.yaml", tmp_path / "cameras.yaml"
    path.write_text(FILE)
    path.chmod(0o640)
    link.symlink_to(path)
    write_camera(link, "lobby", POSE)
    assert link.is_symlink()
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert sorted(os.listdir(tmp_path)) == ["cameras.yaml", "real.yaml"]


@pytest.mark.parametrize(
    ("camera", "old", "new", "message"),
    [
        ("roof", "", "", "there is no camera 'roof'"),
        ("lobby", "[0, 0, 2.5]", "\n      - 0\n      - 0\n      - 2.5", r"line 8: position_m .*by hand"),
        ("hall", "[0, 0, 2.5]", "&there [0, 0, 2.5]", None),
        ("lobby", "    position_m: [0, 0, 2.5]   # guessed\n", "", r"line 5: position_m .*by hand"),
        ("lobby", "cameras:", "cameras: [", "isn't YAML"),
    ],
)
def test_what_cannot_be_edited_is_said_and_left(
    tmp_path: Path, camera: str, old: str, new: str, message: str | None
) -> None:
    text = FILE.replace(old, new) if old else FILE
    if message is None:  # an alias, whose value stands at another camera
        text, message = text.replace("[1, 1, 2]", "*there"), r"line 12: position_m .*by hand"
    path = tmp_path / "cameras.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        write_camera(path, camera, POSE)
    assert path.read_text() == text


def test_a_value_that_the_file_may_not_have_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "cameras.yaml"
    path.write_text(FILE)
    with pytest.raises(ConfigError, match=r"isn't written, because camera lobby couldn't be used.*above its floor"):
        write_camera(path, "lobby", POSE | {"position_m": "[0, 0, 90]"})
    assert path.read_text() == FILE
