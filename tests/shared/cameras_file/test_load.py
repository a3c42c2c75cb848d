from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.cameras_file import load_cameras
from surveilnav.cameras_file.urls import shown, with_secrets
from surveilnav.cameras_file.views import views_of
from surveilnav.errors import ConfigError

GOOD = """\
building: hq
floors:
  ground: {z_m: 0.0}
  first: {z_m: 3.2}
cameras:
  - name: lobby
    label: Eingangshalle Süd
    floor: ground
    stream: rtsp://viewer:${LOBBY_PASSWORD}@10.0.0.5/stream1
    position_m: [2.0, 1.5, 2.6]
    yaw_deg: 90
    pitch_deg: -30
    lens: {width_px: 1920, height_px: 1080, hfov_deg: 96, distortion: [-0.2, 0.05, 0, 0]}
    zones:
      - [[0, 0], [0.2, 0], [0.2, 0.3]]
  - name: corridor
    floor: first
    stream: http://10.0.0.6/snapshot.jpg
    position_m: [0, 0, 5.9]
    yaw_deg: 0
    pitch_deg: -90
    views: around
    lens: {model: fisheye, width_px: 2048, height_px: 2048, hfov_deg: 180}
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "cameras.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_good_file(tmp_path: Path) -> None:
    file = load_cameras(written(tmp_path, GOOD))
    assert (file.building, list(file.floors), list(file.cameras), file.problems) == (
        "hq",
        ["ground", "first"],
        ["lobby", "corridor"],
        (),
    )
    lobby = file.cameras["lobby"]
    assert lobby.pose()[:3, 2] == pytest.approx([0, np.cos(np.pi / 6), -0.5])  # looks along +y and 30 degrees down
    assert lobby.pose()[:3, 3].tolist() == [2.0, 1.5, 2.6]


def test_a_roll_turns_the_camera_clockwise(tmp_path: Path) -> None:
    file = load_cameras(written(tmp_path, GOOD.replace("pitch_deg: -30", "pitch_deg: 0\n    roll_deg: 90")))
    T = file.cameras["lobby"].pose()
    assert T[:3, 2] == pytest.approx([0, 1, 0], abs=1e-9)
    assert T[:3, 0] == pytest.approx([0, 0, -1], abs=1e-9)  # its right side points down


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("name: lobby", "name: Flur Süd/2", 6, "name: expected letters, digits, '_', '.', '-'"),
        ("floor: ground\n", "floor: cellar\n", 8, "floor: there is no floor 'cellar'; there are ground, first"),
        ("[2.0, 1.5, 2.6]", "[2.0, 1.5, 260]", 10, "position_m: the camera is 260.00 m above its floor"),
        ("[2.0, 1.5, 2.6]", "[2.0, 1.5]", 10, "position_m.2: Field required"),
        ("yaw_deg: 90", "yaw_deg: .nan", 11, "yaw_deg: expected a finite number"),
        ("hfov_deg: 96,", "", 13, "lens: expected either hfov_deg (from the data sheet) or focal_px"),
        ("hfov_deg: 96", "hfov_deg: 178", 13, "use `model: fisheye`"),
        ("[-0.2, 0.05, 0, 0]", "[-0.2, 0.05, 0]", 13, "a pinhole lens has 0, 4, 5 or 8 finite coefficients"),
        ("[0.2, 0.3]]", "[0.1, 0]]", 15, "its corners lie on one line"),
        ("[0.2, 0.3]]", "[20, 30]]", 15, "zones.0.2.0: Input should be less than or equal to 1"),
        ("    yaw_deg: 90\n", "    jaw_deg: 90\n", 11, "jaw_deg: Extra inputs are not permitted"),
        ("    yaw_deg: 90\n", "    yaw_deg: 90\n    yaw_deg: 80\n", 6, "line 12: 'yaw_deg' stands there twice"),
    ],
)
def test_a_mistake_in_one_camera_is_named_at_its_line_and_the_others_stay(
    tmp_path: Path, old: str, new: str, line: int, message: str
) -> None:
    assert old in GOOD
    file = load_cameras(written(tmp_path, GOOD.replace(old, new, 1)))
    assert list(file.cameras) == ["corridor"]
    assert any(p.line == line and message in p.message for p in file.problems), [str(p) for p in file.problems]


def test_two_cameras_of_one_name_are_both_left_out(tmp_path: Path) -> None:
    file = load_cameras(written(tmp_path, GOOD.replace("name: corridor", "name: lobby")))
    assert not file.cameras
    assert [p.line for p in file.problems] == [6, 16]
    assert "several cameras have this name (lines 6, 16)" in file.problems[0].message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a table with building, floors, cameras"),
        ("floors: [", "line 1: isn't YAML"),
        ("cameras: []", "expected `floors:`"),
        ("floors: {a: {z: 0}}\ncameras: []", "line 1: floors: a.z_m: Field required"),
        ("floors: {a: {z_m: 0}}", "expected `cameras:` with a list"),
    ],
)
def test_a_file_of_which_nothing_can_be_used(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=r"cameras\.yaml") as error:
        load_cameras(written(tmp_path, text))
    assert message in str(error.value)


def test_an_unknown_entry_is_a_problem_of_no_camera(tmp_path: Path) -> None:
    file = load_cameras(written(tmp_path, GOOD + "camras: []\n"))
    assert [str(p) for p in file.problems] == ["line 24: unknown entry 'camras'; expected building, floors, cameras"]
    assert len(file.cameras) == 2


def test_no_message_holds_a_password(tmp_path: Path) -> None:
    bad = GOOD.replace("${LOBBY_PASSWORD}", "hunter2").replace("stream: rtsp", "stream: [rtsp", 1)
    bad = bad.replace("/stream1", "/stream1]")
    assert "hunter2" not in " ".join(str(p) for p in load_cameras(written(tmp_path, bad)).problems)


def test_secrets_come_from_the_environment() -> None:
    address = "rtsp://viewer:${LOBBY_PASSWORD}@10.0.0.5/1"
    assert with_secrets(address, {"LOBBY_PASSWORD": "x"}) == "rtsp://viewer:x@10.0.0.5/1"
    with pytest.raises(ValueError, match="LOBBY_PASSWORD isn't set"):
        with_secrets(address, {})


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("rtsp://user:p%40ss@10.0.0.5:8554/a/b", "rtsp://10.0.0.5:8554/a/b"),
        ("http://cam/snap.cgi?user=admin&pwd=secret", "http://cam/snap.cgi?..."),
        ("rtsp://u:p@[fe80::1]:554/x", "rtsp://[fe80::1]:554/x"),
        ("rtsp://u:p@h:port/x", "rtsp://..."),
        ("usb:0", "usb:0"),
    ],
)
def test_an_address_is_shown_without_its_secrets(address: str, expected: str) -> None:
    assert shown(address) == expected


def test_a_single_view_looks_where_the_camera_looks(tmp_path: Path) -> None:
    lobby = load_cameras(written(tmp_path, GOOD)).cameras["lobby"]
    made = views_of(lobby)
    assert (made.intrinsics.width_px, made.intrinsics.height_px) == (640, 360)
    assert np.degrees(made.intrinsics.hfov_rad) == pytest.approx(96)
    assert np.allclose(made.poses[0].matrix(), lobby.pose())
    assert made.undistortions[0].shrink >= 2


def test_a_ceiling_fisheye_has_the_papers_thirteen_views(tmp_path: Path) -> None:
    made = views_of(load_cameras(written(tmp_path, GOOD)).cameras["corridor"])
    assert len(made.poses) == 13
    assert made.intrinsics.width_px == made.intrinsics.height_px == 640
    pitches = [np.degrees(np.arcsin(np.clip(pose.matrix()[2, 2], -1, 1))) for pose in made.poses]
    assert pitches == pytest.approx([-30.0] * 12 + [-90.0], abs=1e-3)
    # an equidistant lens of 180 degrees sees 90 degrees to each side; half of a view that looks 60 degrees aside is beyond 10
    assert all(0.5 < u.seen.mean() <= 1.0 for u in made.undistortions)


def test_rooms_of_a_floor(tmp_path: Path) -> None:
    rooms = "ground: {z_m: 0.0, rooms: {Küche: [[0, 0], [4, 0], [4, 3]]}}"
    file = load_cameras(written(tmp_path, GOOD.replace("ground: {z_m: 0.0}", rooms)))
    assert file.floors["ground"].rooms == {"Küche": [(0, 0), (4, 0), (4, 3)]}
    assert file.floors["first"].rooms == {}


@pytest.mark.parametrize(
    ("outline", "told"),
    [
        ("[[0, 0], [4, 0]]", "at least 3"),
        ("[[0, 0], [4, 4], [4, 0], [0, 6]]", "sides 1 and 3 cross"),
        ("[[0, 0], [2, 0], [4, 0]]", "lie on one line"),
        ("[[0, 0], [.inf, 0], [4, 3]]", "finite"),
    ],
)
def test_a_room_that_cant_be_is_named_at_its_line(tmp_path: Path, outline: str, told: str) -> None:
    text = GOOD.replace("ground: {z_m: 0.0}", f"ground:\n    z_m: 0.0\n    rooms:\n      hall: {outline}")
    with pytest.raises(ConfigError, match=f"line [4-6]: floors: .*{told}"):
        load_cameras(written(tmp_path, text))
