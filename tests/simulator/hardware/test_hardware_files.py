"""The simulated hardware's files, and the fisheye pictures that they describe."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from surveilnav.building_file import load_building
from surveilnav.cameras_file import load_cameras
from surveilnav.cameras_file.views import views_of
from surveilnav.geometry import camera_pose
from surveilnav.robot_file import load_robot
from surveilnav.simulator.hardware import describe, fisheye
from surveilnav.simulator.hardware.config import RobotHardwareSettings
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


@pytest.fixture(scope="module")
def building(home_cache: Path) -> SimulatedBuilding:
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        made = SimulatedBuilding(SimulationSettings(building="parametric_flat", cameras=1, lighting="flat"))
        made.prepare()
        return made


def colours_of(rays: np.ndarray) -> np.ndarray:
    """Directions (..., 3) as colours."""
    return np.nan_to_num(np.rint(127.5 + 127.5 * rays)).astype(np.uint8)


def test_a_fisheye_picture_shows_each_direction_where_its_lens_has_it(building: SimulatedBuilding) -> None:
    """Pinhole views whose colours are directions in the world, joined: each pixel has the colour of its own direction."""
    position = building.plan.cameras[0].position_m
    views = []
    for pose in fisheye.poses(position):
        rays = fisheye.VIEW.rays() @ pose[:3, :3].T
        views.append((pose, colours_of(rays / np.linalg.norm(rays, axis=-1, keepdims=True))))
    T_world_lens = camera_pose(position, 0.0, -np.pi / 2)
    rows, cols = np.mgrid[: fisheye.SIDE_PX, : fisheye.SIDE_PX]
    wanted = colours_of(fisheye.lens().rays(np.stack([cols, rows], axis=-1).astype(float)) @ T_world_lens[:3, :3].T)
    off = np.abs(fisheye.join(views, T_world_lens).astype(int) - wanted).max(axis=-1)
    inside = np.hypot(rows - 767.5, cols - 767.5) < fisheye.SIDE_PX / 2 - 1
    assert off[inside].max() <= 2


def test_the_file_has_a_camera_node_make_the_papers_views_of_it(building: SimulatedBuilding, tmp_path: Path) -> None:
    file = tmp_path / "cameras.yaml"
    file.write_text(yaml.safe_dump(describe.cameras_file(building, "rtsp://127.0.0.1:1")))
    camera = building.plan.cameras[0]
    views = views_of(load_cameras(file).cameras[camera.name])
    assert len(views.poses) == len(camera.views) == 13
    for mine, planned in zip(views.poses, camera.views, strict=True):
        np.testing.assert_allclose(mine.matrix(), planned.matrix(), atol=1e-3)


def test_outside_of_its_circle_a_fisheye_picture_is_black(building: SimulatedBuilding) -> None:
    picture = fisheye.render(building, building.plan.cameras[0])
    rows, cols = np.mgrid[: fisheye.SIDE_PX, : fisheye.SIDE_PX] - (fisheye.SIDE_PX - 1) / 2
    radius_px = np.hypot(rows, cols)
    assert not picture[radius_px > fisheye.SIDE_PX / 2 + 1].any()
    assert picture[radius_px < fisheye.SIDE_PX / 2 - 1].any(axis=-1).mean() > 0.99


def test_the_files_describe_one_building(
    building: SimulatedBuilding, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["describe", str(tmp_path), "--rtsp", "rtsp://10.0.0.9:554"])
    monkeypatch.setenv("SURVEILNAV_SIM__BUILDING", "parametric_flat")
    monkeypatch.setenv("SURVEILNAV_SIM__CAMERAS", "1")
    monkeypatch.setenv("SURVEILNAV_ROBOT_HARDWARE__MAP_YAW_DEG", "35")
    describe.main()
    read = load_building(tmp_path / "building.yaml")
    cameras, robot = load_cameras(read.cameras), load_robot(read.robots["r1"])
    assert cameras.cameras["c0-1"].stream == "rtsp://10.0.0.9:554/c0-1"
    assert robot.floor in cameras.floors
    assert robot.floor_z_m == cameras.floors[robot.floor].z_m
    assert robot.T_building_map is not None
    assert (robot.T_building_map.yaw_deg, robot.router) == (35.0, RobotHardwareSettings().router)
    assert robot.topics.scan == ""
    monkeypatch.setenv("SURVEILNAV_ROBOT_HARDWARE__SCANNER", "true")
    describe.main()
    assert load_robot(read.robots["r1"]).topics.scan == "scan"
