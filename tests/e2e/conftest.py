"""A whole system of processes around a small home, lit flat so that it starts fast."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from surveilnav.bus import Node, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.cameras_file import load_cameras
from surveilnav.cli.stack import Stack, bus_name, environment
from surveilnav.contract import MISSION_CANCEL, MISSION_GOAL, MISSION_STATUS, TRAFFIC
from surveilnav.messages import FINISHED_STATES, MissionAck, MissionCancel, MissionGoal, MissionStatus, TrafficReport
from surveilnav.security.folder import SecurityFolder
from surveilnav.security.identities import identity_from_name
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from tests.waiting import patient, until


@dataclass
class System:
    """A running stack and a client on its bus."""

    stack: Stack
    node: Node
    building: SimulatedBuilding
    gateway_port: int = 0

    def submit(self, target: str, mission: str = "m1", max_steps: int = 200) -> MissionAck:
        goal = MissionGoal(stamp_ns=clock_ns(), mission=mission, target=target, max_steps=max_steps)
        return self.node.ask(MISSION_GOAL, goal, mission=mission).message

    def search(self, target: str, **more: Any) -> None:
        """Submits, once the planner has met the robot."""
        said: list[MissionAck] = []

        def taken() -> bool:
            said.append(self.submit(target, **more))
            return said[-1].accepted

        until(taken, lambda: said[-1], timeout_s=30.0)

    def status(self, mission: str = "m1") -> MissionStatus:
        return self.node.ask(MISSION_STATUS, mission=mission).message

    def wait(self, condition: Callable[[MissionStatus], bool], timeout_s: float, mission: str = "m1") -> MissionStatus:
        """The first status that meets the condition. A mission that is over meets it at once or never."""
        status = self.status(mission)

        def met() -> bool:
            nonlocal status
            status = self.status(mission)
            assert condition(status) or status.state not in FINISHED_STATES, f"over: {status}"
            return condition(status)

        until(met, lambda: f"not within {timeout_s} s: {status}", timeout_s)
        return status

    def kill(self, service: str) -> None:
        """SIGKILL, as a power cut would."""
        process = self.stack.processes[service]
        process.kill()
        process.wait()

    def traffic(self, kind: str, id: str) -> TrafficReport:
        return self.node.ask(TRAFFIC, node=f"{kind}-{id}").message


def frame_bytes(report: TrafficReport) -> int:
    """What a camera offered of frames."""
    return sum(row.n_bytes for row in report.rows if "/frame/" in row.key and row.direction == "offered")


@pytest.fixture
def system(tmp_path: Path, home_cache: Path) -> Iterator[Callable[..., System]]:
    """``system(building, cameras=2, ...)`` starts one; it is stopped at the test's end."""
    with starting(tmp_path, home_cache) as start:
        yield start


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[System]:
    """One of a floor with a camera and a gateway; see ``running``."""
    with starting(tmp_path_factory.mktemp("flat"), home_cache) as start:
        yield start(cameras=1, gateway_port=free_port())


@pytest.fixture
def running(flat: System) -> Iterator[System]:
    """One that tests share: each has a mission of its own. A test that fails leaves no mission and no dead service, either."""
    yield flat
    for name, process in flat.stack.processes.items():
        if process.poll() is not None:
            flat.stack.start(name)
    for told in until(lambda: flat.node.ask_all(MISSION_STATUS), timeout_s=30.0):
        if told.message.state not in FINISHED_STATES:
            mission = told.message.mission
            flat.node.ask(MISSION_CANCEL, MissionCancel(stamp_ns=clock_ns(), mission=mission), mission=mission)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[System]:
    """One of two floors, the robot upstairs, for all tests of a file. The third camera downstairs sees the kitchen."""
    with starting(tmp_path_factory.mktemp("house"), home_cache) as start:
        yield start("parametric_house", cameras=5, robot_start="5,4.25,1,0")


@contextmanager
def starting(folder: Path, cache: Path) -> Iterator[Callable[..., System]]:
    with pytest.MonkeyPatch.context() as environ, ExitStack() as exits:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(cache))

        def start(
            building: str = "parametric_flat",
            cameras: int = 2,
            perception: str = "oracle",
            surveillance: bool = True,
            robot_start: str = "",
            gateway_port: int = 0,
            recorder: bool = False,
            cameras_file: Path | None = None,
            robot_file: Path | None = None,
            lighting: str = "flat",
            secure: bool = False,
            shards: str = "",
        ) -> System:
            environ.setenv("SURVEILNAV_SIM__LIGHTING", lighting)
            home = SimulatedBuilding(SimulationSettings(building=building, cameras=cameras))
            home.prepare()
            variables = environment(
                router=f"{'tls' if secure else 'tcp'}/127.0.0.1:{free_port()}",
                building=building,
                seed=0,
                cameras=cameras,
                area_per_camera_m2=100,
                perception=perception,
                surveillance=surveillance,
                robot_start=robot_start,
                state=folder / "state",
                recordings=folder / "recordings",
            )
            names = [c.name for c in home.plan.cameras]
            if cameras_file is not None:
                variables["SURVEILNAV_CAMERA__FILE"] = variables["SURVEILNAV_GATEWAY__CAMERAS_FILE"] = str(cameras_file)
                variables["SURVEILNAV_CAMERA__DEPTH"] = "network"  # which is good on rendered pictures
                names = list(load_cameras(cameras_file).cameras)
            if robot_file is not None:
                variables["SURVEILNAV_ROBOT__FILE"] = str(robot_file)
                if cameras_file is not None:  # nothing of the building is simulated
                    variables["SURVEILNAV_PERCEPTION__SIMULATED"] = "false"
            variables["SURVEILNAV_GATEWAY__PORT"] = str(gateway_port)
            variables["SURVEILNAV_FUSION__SHARDS"] = shards
            security = make_identities(folder / "security", building, names) if secure else None
            stack = exits.enter_context(
                Stack(
                    variables,
                    folder / "logs",
                    names,
                    gateway=bool(gateway_port),
                    recorder=recorder,
                    security=security,
                )
            )
            node = exits.enter_context(Node("test", "e2e", stack.bus, alive=False))
            stack.wait_ready(node, 90)
            patient(node)
            return System(stack, node, home, gateway_port)

        yield start


def make_identities(folder: Path, building: str, cameras: list[str]) -> SecurityFolder:
    """An identity for each process of a simulated building."""
    services = ["router", "perception", "fusion", "planner", "gateway", "recorder", "supervisor", "robot-r1"]
    identities = [identity_from_name(name) for name in [*services, *(f"camera-{name}" for name in cameras)]]
    return SecurityFolder.create(folder, bus_name(building), identities, ("127.0.0.1",), simulation=True)
