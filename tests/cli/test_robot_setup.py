"""``surveilnav robots frame`` and ``robots check``, as a person types them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from surveilnav.bus.router import free_port, open_router
from surveilnav.camera_pose.tag import save_sightings
from surveilnav.cli.main import app
from surveilnav.errors import ConfigError
from surveilnav.robot_file import load_robot, write_frame
from surveilnav.robot_frame import PlanarTransform
from tests.robot_hardware import MAP_X_M, MAP_Y_M, MAP_YAW_DEG, in_map, write_robot_file
from tests.tag_scenes import random_stops, scene_from_poses

PLACES = [(0.0, 0.0), (5.2, 0.0), (5.2, 3.9), (0.0, 3.9)]


@pytest.fixture
def file(tmp_path):
    return write_robot_file(tmp_path / "robot.yaml", "tcp/127.0.0.1:1", T_building_map=None)


def run(*arguments):
    return CliRunner().invoke(app, ["robots", *map(str, arguments)])


def pairs(places):
    return [part for b, m in places for part in ("--pair", f"{b[0]},{b[1]}={m[0]:.3f},{m[1]:.3f}")]


def test_a_frame_is_found_and_written(file):
    done = run("frame", file, *pairs([(b, in_map(*b)) for b in PLACES[:3]]), "--write", "--json")
    assert done.exit_code == 0, done.output
    frame = load_robot(file).T_building_map
    assert (frame.x_m, frame.y_m, frame.yaw_deg) == pytest.approx((MAP_X_M, MAP_Y_M, MAP_YAW_DEG), abs=0.02)
    assert json.loads(done.stdout)["T_building_map"] == frame.model_dump()


def test_who_may_read_the_file_may_read_it_afterwards(file):
    """A container runs as another user."""
    file.chmod(0o644)
    assert run("frame", file, *pairs([(b, in_map(*b)) for b in PLACES]), "--write").exit_code == 0
    assert file.stat().st_mode & 0o777 == 0o644


def test_without_write_the_file_stays_and_a_wrong_pair_is_named(file):
    before = file.read_text()
    wrong = [(b, in_map(*b)) for b in PLACES]
    wrong[2] = wrong[2][0], (9.0, 9.0)
    done = run("frame", file, *pairs(wrong))
    assert done.exit_code == 0, done.output
    assert "3" in done.stdout
    assert "not written" in done.stdout
    assert file.read_text() == before


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["--pair", "1,2"], "expected a place in the building"), (["--pair", "0,0=1,1"], "2")],
)
def test_pairs_that_say_too_little_are_explained(file, arguments, says):
    done = run("frame", file, *arguments)
    assert done.exit_code != 0
    assert says in done.output + str(done.exception or "")


@pytest.mark.parametrize(
    "entry",
    [
        "T_building_map: {x_m: 1, y_m: 2, yaw_deg: 3}  # by hand\n",
        "T_building_map:\n  x_m: 1\n  y_m: 2\n  yaw_deg: 3\n",
        "",
    ],
)
def test_all_other_lines_of_the_file_stay(tmp_path, entry):
    path = tmp_path / "robot.yaml"
    path.write_text(f"# our robot\nrouter: tcp/a:1  # rmw_zenohd\n{entry}floor: ground")
    write_frame(path, PlanarTransform(4.0, 5.0, math.pi / 2))
    assert load_robot(path).T_building_map.model_dump() == {"x_m": 4.0, "y_m": 5.0, "yaw_deg": 90.0}
    text = path.read_text()
    assert text.startswith("# our robot\nrouter: tcp/a:1  # rmw_zenohd\n")
    assert text.count("T_building_map") == 1
    assert "floor: ground" in text.splitlines()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "expected a table that begins with `router:`"),
        ("router: tcp/a:1\nfloor: ground\ndriv: actions\n", r"line 3: driv: Extra inputs"),
        ("router: tcp/a:1\n", "floor: Field required"),
        ("router: tcp/a:1\nfloor: g\nbody: {radius_m: -1}\n", r"line 3: body.radius_m"),
        ("router: tcp/a:1\nfloor: g\nT_building_map: {x_m: .nan, y_m: 0, yaw_deg: 0}\n", "expected a finite number"),
        ("router: [\n", "isn't YAML"),
    ],
)
def test_a_mistake_in_the_file_is_named_at_its_line(tmp_path, text, says):
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=says):
        load_robot(path)


def test_a_router_that_is_not_there_is_said_with_what_to_do(tmp_path):
    done = run("check", write_robot_file(tmp_path / "robot.yaml", f"tcp/127.0.0.1:{free_port()}"), "--seconds", "1")
    assert done.exit_code == 1
    assert "problem  router: no router of the robot at" in done.stdout
    assert "rmw_zenohd" in done.stdout


def test_a_robot_that_says_nothing_is_listed_part_by_part(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        done = run("check", write_robot_file(tmp_path / "robot.yaml", endpoint), "--seconds", "1", "--json")
    assert done.exit_code == 1
    checks = {c["part"]: c for c in json.loads(done.stdout)["checks"]}
    assert checks["router"]["ok"]
    assert not any(c["ok"] for part, c in checks.items() if part not in ("router", "clock"))
    assert checks["depth"]["message"] == "nobody publishes /camera/depth/image_raw. Set topics.depth in the file"
    assert "ros2 action list" in checks["Nav2"]["message"]


CAMERAS = """\
floors: {ground: {z_m: 0}}
cameras:
  - name: lobby
    floor: ground
    stream: lobby.mp4
    position_m: [0, 0, 2.5]
    yaw_deg: 0
    pitch_deg: -25
    lens: {width_px: 1920, height_px: 1080, hfov_deg: 85}
"""


def write_sightings(path, T_building_map, T_building_reported):
    """What the robot's tag looked like, and where the robot said it stood by a frame that isn't its own."""
    scene = scene_from_poses(random_stops(np.random.default_rng(0), 10))
    T = T_building_reported @ T_building_map.inverse()
    for stop in scene.sightings.stops:
        stop.x_m, stop.y_m = map(float, T.apply((stop.x_m, stop.y_m)))
        stop.yaw_rad += T.yaw_rad
    save_sightings(path, scene.sightings)


@pytest.mark.parametrize("said", [None, PlanarTransform(1.0, 2.0, 0.3)])
def test_a_frame_is_found_from_the_tag_whatever_the_file_said_before(tmp_path, said):
    entry = None if said is None else {"x_m": said.x_m, "y_m": said.y_m, "yaw_deg": math.degrees(said.yaw_rad)}
    robot = write_robot_file(tmp_path / "robot.yaml", "tcp/127.0.0.1:1", T_building_map=entry)
    (tmp_path / "cameras.yaml").write_text(CAMERAS)
    T = PlanarTransform(7.0, -3.0, 2.1)
    write_sightings(tmp_path / "tag.yaml", T, said or PlanarTransform())
    files = "--sightings", tmp_path / "tag.yaml", "--cameras", tmp_path / "cameras.yaml"
    done = run("frame", robot, *files, "--write", "--json")
    assert done.exit_code == 0, done.output
    frame = load_robot(robot).T_building_map
    assert (frame.x_m, frame.y_m) == pytest.approx((7.0, -3.0), abs=0.01)
    assert frame.yaw_deg == pytest.approx(math.degrees(2.1), abs=0.1)


def test_a_frame_is_found_from_two_map_files(tmp_path):
    rng = np.random.default_rng(3)
    cells = made_up_map(rng)
    write_map(tmp_path / "theirs", cells, (0.0, 0.0, 0.0))
    write_map(tmp_path / "own", cells, (0.0, 0.0, 0.0))
    (tmp_path / "building.yaml").write_text(
        "building: shed\nfloors:\n  ground:\n    nav2_map: theirs.yaml\n"
        "    T_building_map: {x_m: 4.0, y_m: 2.0, yaw_deg: 35.0}\n"
    )
    robot = write_robot_file(tmp_path / "robot.yaml", "tcp/127.0.0.1:1", T_building_map=None, floor="ground")
    done = run("frame", robot, "--map", tmp_path / "own.yaml", "--building", tmp_path / "building.yaml", "--json")
    assert done.exit_code == 0, done.output + str(done.exception)
    found = json.loads(done.stdout)["T_building_map"]
    assert (found["x_m"], found["y_m"], found["yaw_deg"]) == pytest.approx((4.0, 2.0, 35.0), abs=0.1)


def made_up_map(rng):
    """(rows, cols) of grey: a floor with walls and furniture at cells of 5 cm."""
    cells = np.full((160, 220), 254, np.uint8)
    cells[:3], cells[-3:], cells[:, :3], cells[:, -3:] = 0, 0, 0, 0
    cells[60:63, :150] = 0
    cells[90:, 130:133] = 0
    for _ in range(14):
        row, col = rng.integers(8, 140), rng.integers(8, 200)
        cells[row : row + rng.integers(6, 16), col : col + rng.integers(6, 18)] = 0
    return cells


def write_map(stem, cells, origin):
    height, width = cells.shape
    stem.with_suffix(".pgm").write_bytes(f"P5 {width} {height} 255\n".encode() + cells[::-1].tobytes())
    stem.with_suffix(".yaml").write_text(f"image: {stem.name}.pgm\nresolution: 0.05\norigin: {list(origin)}\n")


@pytest.mark.parametrize("arguments", [[], ["--pair", "0,0=1,1", "--map", "map.yaml"]])
def test_exactly_one_way_is_chosen(file, arguments):
    done = run("frame", file, *arguments)
    assert done.exit_code == 2
    assert "exactly one of" in " ".join(done.output.split())
