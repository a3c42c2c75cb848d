"""``surveilnav up``: the whole system on this machine until Ctrl-C."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from rich.console import Console

from surveilnav.bus import Node
from surveilnav.camera_plan import CameraPlan
from surveilnav.cli.hardware import Hardware
from surveilnav.cli.progress import bar
from surveilnav.cli.stack import Stack, bus_name, environment
from surveilnav.cli.supervisor import Supervisor
from surveilnav.cli.words import why_perceived
from surveilnav.contract import PERCEPTION_LOAD
from surveilnav.errors import ConfigError
from surveilnav.security.folder import SecurityFolder
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings

#: How often it is looked whether a service has ended.
_TEND_S = 0.1


def run_up(
    console: Console,
    *,
    building: str,
    seed: int,
    perception: str,
    surveillance: bool,
    cameras: int | None,
    area_per_camera_m2: float,
    cameras_everywhere: bool,
    port: int,
    router: str,
    logs: Path,
    record: bool,
    security: Path | None = None,
    as_real: bool = False,
) -> None:
    """Prepares the building, starts everything, and waits.

    ``as_real``: cameras and robot are hardware of the simulated building, and SurveilNav meets them on their wires alone.
    """
    settings = SimulationSettings(
        building=building,
        seed=seed,
        cameras=cameras,
        area_per_camera_m2=area_per_camera_m2,
        cameras_everywhere=cameras_everywhere,
    )
    plan = _prepare(console, settings)
    # Maps and missions of a building, to go on with next time; never those of another one, or of its plan before a change.
    state = logs / "state" / plan.scene_hash[:16]
    folder = _security(security, building)
    variables = environment(
        router=router.replace("tcp/", "tls/", 1) if folder else router,
        building=building,
        seed=seed,
        cameras=cameras,
        area_per_camera_m2=area_per_camera_m2,
        perception=perception,
        surveillance=surveillance,
        state=state,
        cameras_everywhere=cameras_everywhere,
        recordings=logs.parent / "recordings",
    ) | _gateway_variables(port, logs)
    names = [camera.name for camera in plan.cameras] if surveillance else []
    stopping = _set_by_signals()
    with (
        _hardware(console, variables, logs) if as_real else nullcontext(dict[str, str]()) as real,
        Stack(variables | real, logs, names, gateway=True, recorder=record, security=folder) as stack,
        Node("cli", "up", stack.bus, alive=False) as node,
    ):
        stack.wait_ready(node, 120.0)  # what ends before all are ready has a reason that no restart mends
        console.print(
            f"ready: http://127.0.0.1:{port}/  (building {plan.building}, {len(names)} cameras; logs in {logs}, "
            f"maps and missions in {state})"
        )
        if record:
            console.print(f"recordings: {variables['SURVEILNAV_RECORDER__FOLDER']}", markup=False)
        _print_perception(console, node)
        console.print('try: surveilnav find "tv"    stop: Ctrl-C')
        supervisor = Supervisor(stack, node, lambda text: console.print(text, markup=False, soft_wrap=True))
        while not stopping.wait(_TEND_S):
            supervisor.tend()
    console.print("stopped")


def _prepare(console: Console, settings: SimulationSettings) -> CameraPlan:
    """Prepares the building, prints what is worth noting about it, and returns its camera plan."""
    with bar(console) as progress:
        simulated = SimulatedBuilding(settings, progress)
        plan = simulated.prepare()
    for note in simulated.notes:
        console.print(f"note: {note}", markup=False)
    return plan


@contextmanager
def _hardware(console: Console, variables: dict[str, str], logs: Path) -> Iterator[dict[str, str]]:
    """Runs the simulated building's cameras and robot as hardware; yields the services' settings that lead to them."""
    logs.mkdir(parents=True, exist_ok=True)
    with Hardware(variables, logs) as hardware:
        console.print(
            f"hardware: cameras at {hardware.rtsp}, a ROS 2 robot at {hardware.ros_router}; the building is described in "
            f"{hardware.building_file}",
            markup=False,
            soft_wrap=True,
        )
        yield hardware.settings()


def _security(path: Path | None, building: str) -> SecurityFolder | None:
    """The folder with the identities of all processes; None: no security. ConfigError: it is another building's."""
    if path is None:
        return None
    folder, name = SecurityFolder(path), bus_name(building)
    if folder.building != name:
        raise ConfigError(
            f"{path} is for the building {folder.building!r}, not {name!r}: make another one by `surveilnav security init FOLDER "
            f"--building {name} --simulation --shared-cameras`"
        )
    return folder


def _gateway_variables(port: int, logs: Path) -> dict[str, str]:
    """The gateway's settings. Who looked at which camera is kept whatever the building's plan: the environment may say
    where else, or "" for nowhere."""
    access_log = os.environ.get("SURVEILNAV_GATEWAY__ACCESS_LOG", str((logs / "looks").resolve()))
    return {"SURVEILNAV_GATEWAY__PORT": str(port), "SURVEILNAV_GATEWAY__ACCESS_LOG": access_log}


def _set_by_signals() -> threading.Event:
    """An event that Ctrl-C and SIGTERM set from now on."""
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    return stopping


def _print_perception(console: Console, node: Node) -> None:
    """Prints which backend each perception worker runs, and why."""
    for load in (answer.message for answer in node.ask_all(PERCEPTION_LOAD)):
        console.print(f"perception: {load.backend} ({why_perceived(load.why, load.calibrated)})", markup=False)
