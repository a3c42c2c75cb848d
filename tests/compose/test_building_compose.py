"""compose.building.yaml with what `surveilnav init` writes: real sources and a robot with ROS 2, and nothing simulated inside."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from surveilnav.simulator.simulation import SimulatedBuilding
from tests import rendered_streams
from tests.compose.stack import ROOT, UP_S, Stack, host_as_containers_see_it, missing
from tests.robot_hardware import Hardware, in_map, robot_hardware, true_state
from tests.waiting import until

pytestmark = [pytest.mark.compose, pytest.mark.slow, pytest.mark.timeout(UP_S + 600)]


def surveilnav(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).parent / "surveilnav"), *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


class Site(Stack):
    """The running building, its hardware and the folder of its files."""

    folder: Path
    hardware: Hardware


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[Site]:
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    host, videos = host_as_containers_see_it(), tmp_path_factory.mktemp("videos")
    folder = tmp_path_factory.mktemp("site") / "hq"
    folder.parent.parent.chmod(0o755)  # containers run as another user
    folder.parent.chmod(0o755)
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        environ.setenv("SURVEILNAV_SIM__LIGHTING", "baked")
        with (
            rendered_streams.served(videos, host) as streams,
            robot_hardware(videos, rendered_streams.BUILDING, start="6.67,6.08,0,30", host=host) as robot,
        ):
            answers = videos / "answers.yaml"
            answers.write_text(yaml.safe_dump(answers_of(streams, videos, robot.router)))
            done = surveilnav("init", str(folder), "--answers", str(answers))
            assert done.returncode == 0, done.stdout + done.stderr
            measure_frame(folder / "robots" / "r1.yaml")
            models = tmp_path_factory.mktemp("models")
            models.chmod(0o755)
            over = str(folder / "compose.override.yaml")
            site = Site(models, "compose.building.yaml", over, SURVEILNAV_PERCEPTION__BACKEND="compact")
            site.folder, site.hardware = folder, robot
            with site.running():
                yield site


def answers_of(streams: rendered_streams.Streams, folder: Path, router: str) -> dict[str, Any]:
    """What somebody who has measured everything answers."""
    file = yaml.safe_load(streams.cameras_yaml())
    write_map(streams.building, folder)
    cameras = [
        {
            "name": camera["name"],
            "floor": camera["floor"],
            "stream": camera["stream"],
            "hfov_deg": camera["lens"]["hfov_deg"],
            "position_m": camera["position_m"],
            "yaw_deg": camera["yaw_deg"],
            "pitch_deg": camera["pitch_deg"],
        }
        for camera in file["cameras"]
    ]
    floor = {"z_m": file["floors"]["0"]["z_m"], "plan": "map.yaml", "nav2_map": "map.yaml"}
    robot = {"router": router, "floor": "0"}
    return {"building": "Parametric flat", "floors": {"0": floor}, "cameras": cameras, "robots": {"r1": robot}}


def write_map(building: SimulatedBuilding, folder: Path) -> None:
    """The floor as Nav2's map_saver would write it, in the building's frame."""
    ground = building.navigation.floors["0"]
    grey = np.where(ground.obstacle, 0, np.where(ground.supported & ground.indoor, 254, 205)).astype(np.uint8)
    cv2.imwrite(str(folder / "map.pgm"), grey[::-1])
    origin = [ground.grid.origin_x_m, ground.grid.origin_y_m, 0]
    entries = {"image": "map.pgm", "resolution": ground.grid.resolution_m, "origin": origin, "negate": 0}
    (folder / "map.yaml").write_text(yaml.safe_dump(entries | {"occupied_thresh": 0.65, "free_thresh": 0.25}))


def measure_frame(file: Path) -> None:
    """Finds where the robot's map lies from four places, as a person does."""
    places = [(0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0)]
    pairs = [f"{x},{y}={u:.3f},{v:.3f}" for (x, y) in places for (u, v) in [in_map(x, y)]]
    done = surveilnav("robots", "frame", str(file), *(word for p in pairs for word in ("--pair", p)), "--write")
    assert done.returncode == 0, done.stdout + done.stderr


def true_place(site: Site) -> tuple[float, float]:
    """Where the robot is in truth [m]."""
    stands = true_state(site.hardware.router)
    return stands.x_m, stands.y_m


def problems_of(done: subprocess.CompletedProcess[str]) -> Sequence[dict[str, str]]:
    return [f for f in json.loads(done.stdout)["findings"] if f["level"] == "problem"]


def test_the_robot_is_where_it_is_in_truth_and_the_cameras_are_live(site: Site) -> None:
    until(lambda: site.get("/api/v1/robots")["items"], site.state, 60.0)
    (robot,) = site.get("/api/v1/robots")["items"]
    assert math.dist(robot["position_m"][:2], true_place(site)) < 0.2, robot

    def live() -> list[str]:
        return sorted(c["id"] for c in site.get("/api/v1/cameras")["items"] if c["stream"]["state"] == "live")

    until(lambda: live() == ["c0-1v2", "c0-1v8"], site.state, 60.0)


def test_the_doctor_finds_nothing_to_mend(site: Site) -> None:
    file = str(site.folder / "building.yaml")
    done = surveilnav("doctor", "--building", file, "--url", str(site.gateway.base_url), "--json")
    assert problems_of(done) == [], done.stderr
    assert done.returncode == 0
    told = {f["what"]: f["detail"] for f in json.loads(done.stdout)["findings"]}
    assert "processes answer" in told["running system"]


def test_a_search_moves_the_robot(site: Site) -> None:
    before = true_place(site)
    ended = site.search("tv")
    assert ended["state"] == "done", site.state()
    assert math.dist(before, true_place(site)) > 0.3


def test_the_images_hold_no_simulator(site: Site) -> None:
    assert {c["Image"] for c in site.containers()} == {"surveilnav"}
