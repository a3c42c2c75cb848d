"""Nothing simulated in the wiring: RTSP cameras without depth, and a robot that is met by ROS 2 alone, find a target together."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from surveilnav.bus.router import free_port
from surveilnav.contract import MISSION_PLAN, ROBOT_STATUS
from surveilnav.messages import FINISHED_STATES, RobotStatus
from surveilnav.simulator.world.goals import find_goals, judge
from tests import rendered_streams
from tests.e2e.conftest import System, starting
from tests.robot_hardware import Hardware, robot_hardware, true_state
from tests.waiting import until

#: Has Python refuse to import the simulator (``sitecustomize``).
REFUSAL = Path(__file__).parent / "without_simulator"


@dataclass
class Real:
    """The services, and the hardware that they are connected to."""

    system: System
    robot: Hardware
    cameras_file: Path


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[Real]:
    folder = tmp_path_factory.mktemp("real")
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        environ.setenv("SURVEILNAV_SIM__LIGHTING", "baked")
        with (
            rendered_streams.served(folder) as streams,
            robot_hardware(folder, rendered_streams.BUILDING, start="6.67,6.08,0,30") as robot,
            starting(tmp_path_factory.mktemp("system"), home_cache) as start,
        ):
            environ.setenv("PYTHONPATH", str(REFUSAL))
            file = folder / "cameras.yaml"
            file.write_text(streams.cameras_yaml())
            yield Real(
                start(
                    cameras=1,
                    perception="compact",
                    cameras_file=file,
                    robot_file=robot.file,
                    lighting="baked",
                    gateway_port=free_port(),
                    recorder=True,
                ),
                robot,
                file,
            )


def status_of(system: System) -> RobotStatus:
    status: RobotStatus = system.node.ask(ROBOT_STATUS, robot="r1").message
    return status


@pytest.mark.slow
def test_the_robot_is_where_its_file_and_its_transforms_put_it(real: Real) -> None:
    until(lambda: status_of(real.system).seq > 0, lambda: status_of(real.system).message, timeout_s=30.0)
    status = status_of(real.system)
    true = true_state(real.robot.router)
    assert math.dist(status.T_world_base.translation_m[:2], (true.x_m, true.y_m)) < 0.15
    T = status.T_world_base.matrix()
    assert abs(math.remainder(math.atan2(T[1, 0], T[0, 0]) - true.yaw_rad, 2 * math.pi)) < 0.05
    assert (status.description.drive, status.description.camera_height_m) == ("waypoints", pytest.approx(0.88))


@pytest.mark.slow
def test_a_check_of_the_robot_finds_all_that_is_needed(real: Real) -> None:
    done = subprocess.run(
        [Path(sys.executable).parent / "surveilnav", "robots", "check", real.robot.file, "--seconds", "3"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    parts = [line.split(":")[0].split()[-1] for line in done.stdout.splitlines()]
    assert parts == [
        "router",
        "odometry",
        "colour",
        "depth",
        "camera_info",
        "clock",
        "pictures",
        "place",
        "camera",
        "Nav2",
    ]
    assert "0.88 m above its base" in done.stdout


@pytest.mark.slow
def test_the_doctor_finds_nothing_to_mend_in_the_building(real: Real, tmp_path: Path) -> None:
    file = tmp_path / "building.yaml"
    cameras, robot = real.cameras_file, real.robot.file
    file.write_text(f"building: flat\ncameras: {cameras}\nrobots: {{r1: {robot}}}\n")
    url = f"http://127.0.0.1:{real.system.gateway_port}"
    done = subprocess.run(
        [Path(sys.executable).parent / "surveilnav", "doctor", "--building", file, "--url", url, "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    findings = {f["what"]: f for f in json.loads(done.stdout)["findings"]}
    assert done.returncode == 0, findings
    assert {"camera c0-1v8, stream", "camera c0-1v8, place", "robot r1, place", "robot r1, Nav2"} <= set(findings)
    assert "processes answer" in findings["running system"]["detail"]


@pytest.mark.slow
def test_a_search_is_found_and_the_robot_stands_at_the_target_in_truth(real: Real) -> None:
    system = real.system
    system.search("tv")
    status = system.wait(lambda s: s.state in FINISHED_STATES, 240.0)
    assert (status.state, status.found) == ("done", True), status
    plan = system.node.ask(MISSION_PLAN, mission="m1").message
    assert plan.action == "stop"
    stands = true_state(real.robot.router)
    building = system.building
    goals = find_goals(building.scene, building.navigation, "tv", caster=building.caster)
    verdict = judge(goals, stands, shortest_path_m=0.0)
    assert verdict.distance_to_viewpoint_m < 0.5, "it stands at a tv, but for its own error of localisation"


@pytest.mark.slow
def test_no_process_of_the_system_can_import_the_simulator(real: Real) -> None:
    """All of them run with this refusal, and the search above was found."""
    done = subprocess.run(
        [sys.executable, "-c", "import surveilnav.simulator"], capture_output=True, text=True, check=False
    )
    assert "the simulator isn't part of a real building" in done.stderr
    for name, process in real.system.stack.processes.items():
        assert str(REFUSAL).encode() in Path(f"/proc/{process.pid}/environ").read_bytes(), name
