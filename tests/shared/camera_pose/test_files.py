from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.camera_pose import FloorPlan, load_clicks, load_floor_plan
from surveilnav.camera_pose.points import ClickedPoint, ClicksFile, save_clicks
from surveilnav.errors import ConfigError

MAP = (
    "image: map.png\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
)
CLICKS = """\
camera: lobby
plan: map.yaml
points:
  - {px: [100, 200], plan_px: [0, 99]}      # a corner
  - px: [300.5, 400]
    xy_m: [2, 3]
    z_m: 2.0
"""
coordinate = st.floats(-500, 500)


def folder(tmp_path: Path, map_text: str = MAP, clicks: str = CLICKS) -> Path:
    picture = np.full((100, 200), 254, np.uint8)
    picture[:, :2] = 0
    picture[0, 50:60] = 205  # unknown, in Nav2's maps
    cv2.imwrite(str(tmp_path / "map.png"), picture)
    (tmp_path / "map.yaml").write_text(map_text, encoding="utf-8")
    (tmp_path / "clicks.yaml").write_text(clicks, encoding="utf-8")
    return tmp_path


def test_a_map_of_nav2(tmp_path: Path) -> None:
    plan = load_floor_plan(folder(tmp_path) / "map.yaml")
    assert (plan.width_px, plan.height_px, plan.resolution_m) == (200, 100, 0.05)
    # The centre of the lower left pixel lies half a pixel inside the origin, which is the picture's lower left corner.
    assert plan.world_of(np.array([0.0, 99.0])) == pytest.approx([-0.975, -1.975])
    assert plan.world_of(np.array([199.5, -0.5])) == pytest.approx([9.0, 3.0])
    assert int(plan.walls.sum()) == 200
    assert load_floor_plan(folder(tmp_path, MAP.replace("negate: 0", "negate: 1")) / "map.yaml").walls.sum() > 19_000


@given(coordinate, coordinate, st.floats(-4, 4), coordinate, coordinate)
def test_pixels_and_places_are_inverse(column: float, row: float, yaw: float, x: float, y: float) -> None:
    plan = FloorPlan(200, 100, 0.05, (x, y), yaw)
    pixel = np.array([column, row])
    assert plan.pixels_of(plan.world_of(pixel)) == pytest.approx(pixel, abs=1e-6)


def test_a_plan_is_turned_about_its_lower_left_corner() -> None:
    plan = FloorPlan(200, 100, 0.1, (1.0, 2.0), math.pi / 2)
    assert plan.world_of(np.array([9.5, 99.5])) == pytest.approx([1.0, 3.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image: map.png\n", r"map.yaml, line 1: resolution is missing: expected the plan's scale"),
        (MAP.replace("0.05", "0"), r"line 2: resolution is 0, which doesn't fit"),
        (MAP.replace("0.05", "-0.05"), r"line 2: resolution is -0.05"),
        (MAP.replace("0.05", ".nan"), r"line 2: resolution is nan"),
        (MAP.replace("image: map.png", "picture: map.png"), r"image is missing: expected the plan's picture"),
        (MAP.replace("map.png", "none.png"), r"line 1: image: there is no file .*none.png"),
        (MAP.replace("map.png", "map.yaml"), r"line 1: image: .*isn't a picture"),
        (MAP.replace("[-1.0, -2.0, 0.0]", "here"), r"line 3: origin is 'here'.*lower left corner"),
        ("- 1\n", "expected a table with image, resolution and origin"),
        ("image: [\n", "line 2: isn't YAML"),
    ],
)
def test_a_plan_with_a_mistake(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_floor_plan(folder(tmp_path, text) / "map.yaml")


def test_clicks(tmp_path: Path) -> None:
    clicks = load_clicks(folder(tmp_path) / "clicks.yaml")
    assert clicks.camera == "lobby"
    assert clicks.pixels.tolist() == [[100, 200], [300.5, 400]]
    assert clicks.p_floor == pytest.approx(np.array([[-0.975, -1.975, 0], [2, 3, 2]]))
    assert clicks.lines == (4, 5)
    assert clicks.plan is not None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("camera: lobby\n", "", r"camera: Field required"),
        ("xy_m: [2, 3]", "xy_m: [2]", r"line 6: point 2: xy_m.1: Field required"),
        ("xy_m: [2, 3]", "xy_m: [2, east]", r"line 6: point 2: xy_m.1: .*valid number"),
        ("    xy_m: [2, 3]\n", "", r"line 5: point 2: expected its place once"),
        ("    z_m: 2.0", "    plan_px: [1, 1]", r"line 5: point 2: expected its place once"),
        ("z_m: 2.0", "z: 2.0", r"line 7: point 2: z: Extra inputs"),
        ("z_m: 2.0", "z_m: .inf", r"line 7: point 2: z_m"),
        ("z_m: 2.0", "z_m: 200", r"line 7: point 2: z_m: .*less than or equal to 50"),
        ("[0, 99]", "[0, 100]", r"line 4: point 1: plan_px \(0, 100\) lies outside the plan's picture of 200 x 100"),
        ("plan: map.yaml\n", "", r"line 3: point 1: plan_px needs a plan"),
        ("map.yaml", "no.yaml", r"the file of a floor plan can't be read.*no.yaml"),
        ("px: [100, 200]", "px: [100, 200], px: [1, 1]", r"line 4: 'px' stands there twice"),
        (CLICKS, "", "the file is empty"),
        (CLICKS, "camera: lobby\npoints: []\n", r"line 2: points: .*at least 1 item"),
    ],
)
def test_clicks_with_a_mistake(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_clicks(folder(tmp_path, clicks=CLICKS.replace(old, new)) / "clicks.yaml")


def test_a_plan_in_the_folder_of_nobody_is_named(tmp_path: Path) -> None:
    clicks = CLICKS.replace("plan: map.yaml", "plan: ~nobody-of-that-name/map.yaml")
    assert clicks != CLICKS
    with pytest.raises(ConfigError, match="plan: "):
        load_clicks(folder(tmp_path, clicks=clicks) / "clicks.yaml")


def test_all_mistakes_of_clicks_are_named(tmp_path: Path) -> None:
    text = CLICKS.replace("px: [300.5, 400]", "px: [300.5]").replace("plan_px: [0, 99]", "plan_px: 7")
    with pytest.raises(ConfigError, match=r"line 4: point 1: plan_px(?s:.)*line 5: point 2: px.1"):
        load_clicks(folder(tmp_path, clicks=text) / "clicks.yaml")


@pytest.mark.parametrize("name", ["map.yaml", "plan: 1 # Größe.yaml", '"x" \\ y.yaml'])
def test_saved_clicks_are_read_again(tmp_path: Path, name: str) -> None:
    folder(tmp_path)
    (tmp_path / "map.yaml").rename(tmp_path / name)
    points = [
        ClickedPoint(px=(10.256, 20), plan_px=(3.5, 4.25)),
        ClickedPoint(px=(1, 2), plan_px=(-0.5, 99.5), z_m=2.05),
        ClickedPoint(px=(5, 6), xy_m=(-100.1234, 3e-5), z_m=-0.5),
    ]
    save_clicks(tmp_path / "new.yaml", ClicksFile(camera="lobby", plan=name, points=points))
    clicks = load_clicks(tmp_path / "new.yaml")
    assert clicks.pixels == pytest.approx(np.array([[10.26, 20], [1, 2], [5, 6]]))
    assert clicks.plan is not None
    on_plan = clicks.plan.world_of(np.array([[3.5, 4.25], [-0.5, 99.5]]))
    assert clicks.p_floor[:, :2] == pytest.approx(np.array([*on_plan, [-100.1234, 0.0]]))
    assert clicks.p_floor[:, 2].tolist() == [0, 2.05, -0.5]


def test_clicks_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    clicks = ClicksFile(camera="lobby", points=[ClickedPoint(px=(1, 2), xy_m=(3, 4))])
    with pytest.raises(ConfigError, match=r"clicks\.yaml can't be written"):
        save_clicks(tmp_path / "file" / "clicks.yaml", clicks)
