"""Searches of homes on the hardware that `surveilnav up --as-real` starts, each recorded from its first view to its last."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from surveilnav.bus.router import free_port
from surveilnav.cli.hardware import Hardware
from surveilnav.cli.replay.check import check
from surveilnav.contract import MISSION_PLAN, RECORDINGS, VIEW_LOG
from surveilnav.messages import FINISHED_STATES
from surveilnav.services.recorder.recorded import RecordedMessage, read_recording
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.goals import find_goals, judge, sample_start
from tests.e2e.conftest import System, starting
from tests.e2e.test_as_real import REFUSAL
from tests.robot_hardware import true_state
from tests.waiting import until

pytestmark = pytest.mark.slow


class Home(NamedTuple):
    """A building of the simulator, how many cameras it has, and what is searched in it."""

    building: str
    cameras: int
    target: str


HOMES = [Home("studio", 1, "tv"), Home("1_bedroom", 1, "bed")]


@pytest.fixture(params=HOMES, ids=[home.building for home in HOMES])
def home(
    request: pytest.FixtureRequest, tmp_path: Path, home_cache: Path
) -> Iterator[tuple[System, Hardware, SimulatedBuilding, str]]:
    """The system on a home's hardware. Services that import the simulator would end with an error."""
    building, n_cameras, target = request.param
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        environ.setenv("SURVEILNAV_SIM__LIGHTING", "baked")
        made = SimulatedBuilding(SimulationSettings(building=building, cameras=n_cameras))
        goals = find_goals(made.scene, made.navigation, target, caster=made.caster)
        start = sample_start(made.scene, made.navigation, goals, seed=0, caster=made.caster)
        environ.setenv("SURVEILNAV_ROBOT_HARDWARE__START", start.setting())
        environ.setenv("SURVEILNAV_SIM__BUILDING", building)
        environ.setenv("SURVEILNAV_SIM__CAMERAS", str(n_cameras))
        with (
            Hardware({"SURVEILNAV_PERCEPTION__BACKEND": "compact"}, tmp_path) as hardware,
            starting(tmp_path, home_cache) as start_system,
        ):
            environ.setenv("PYTHONPATH", str(REFUSAL))
            files = hardware.building_file.parent
            system = start_system(
                building,
                cameras=n_cameras,
                perception="compact",
                cameras_file=files / "cameras.yaml",
                robot_file=files / "robots" / "r1.yaml",
                lighting="baked",
                gateway_port=free_port(),
                recorder=True,
            )
            yield system, hardware, made, target


def test_a_home_is_searched_and_the_whole_search_recorded(
    home: tuple[System, Hardware, SimulatedBuilding, str],
) -> None:
    system, hardware, building, target = home
    system.search(target)
    status = system.wait(lambda s: s.state in FINISHED_STATES, 300.0)
    assert (status.state, status.found) == ("done", True), status
    stands = true_state(hardware.ros_router)
    goals = find_goals(building.scene, building.navigation, target, caster=building.caster)
    assert judge(goals, stands, shortest_path_m=0.0).distance_to_viewpoint_m < 0.5, "in truth"
    _check_recording(system)


def _check_recording(system: System) -> None:
    """From its file the same maps come again, bit for bit; it has the robot's views, the cameras', and the decisions."""

    def complete() -> list[Path]:
        folder = Path(system.stack.environment["SURVEILNAV_RECORDER__FOLDER"])
        rows = [r for told in system.node.ask_all(RECORDINGS) for r in told.message.recordings if r.mission == "m1"]
        return [folder / f"{r.id}.mcap" for r in rows if r.state == "complete"]

    until(complete, timeout_s=40.0)
    (path,) = complete()
    heard = [m for m in read_recording(path) if isinstance(m, RecordedMessage)]
    sources = {m.message.source for m in heard if m.stream is VIEW_LOG}
    assert "robot/r1" in sources
    assert any(source.startswith("camera/") for source in sources)
    assert any(m.message.action == "stop" for m in heard if m.stream is MISSION_PLAN)
    assert check(path).same, check(path)
