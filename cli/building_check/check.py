"""Checks all parts of a building: files first, then everything on the network at once, each with a deadline."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from surveilnav.cli.building_check.camera_check import check_place, check_stream
from surveilnav.cli.building_check.files import Files, read_files
from surveilnav.cli.building_check.floor_check import Extent, check_floors
from surveilnav.cli.building_check.system_check import check_system
from surveilnav.cli.finding import Finding
from surveilnav.cli.perception_check import check_weights
from surveilnav.cli.robot_check import check_robot
from surveilnav.cli.stream_probe import at_once, deadline_s
from surveilnav.errors import ConfigError
from surveilnav.robot_file import RobotFile

#: So long a camera's pictures are counted.
_COUNT_S = 2.0
_LOCAL = re.compile(r"(^|[/@])(localhost|127\.\d+\.\d+\.\d+|\[::1\])([:/]|$)")


def examine_building(
    path: Path, seconds: float, url: str, progress: Callable[[int, int, str], None] = lambda done, of, which: None
) -> list[Finding]:
    """Looks at all parts of a building.

    Args:
        seconds: how long each robot is listened to.
        url: the running system's gateway.
        progress: is told (done, of, which) of what is looked at on the network.
    """
    try:
        files, findings = read_files(path)
    except ConfigError as error:
        return [Finding(str(path), "problem", str(error), "surveilnav init writes one")]
    extents, of_floors = check_floors(files)
    wait_s = seconds + deadline_s(len(files.cameras.cameras) if files.cameras else 0)
    tasks = _tasks(files, extents, seconds, url)
    done: list[str] = []

    def on_done(name: str) -> None:
        done.append(name)
        progress(len(done), len(tasks), name)

    found = at_once(tasks, wait_s, lambda name: _late(name, wait_s), on_done)
    return [*findings, *of_floors, *(finding for part in found.values() for finding in part)]


def _late(name: str, wait_s: float) -> list[Finding]:
    return [Finding(name, "problem", f"nothing came within {wait_s:.0f} s", "check its address and the network")]


def _tasks(
    files: Files, extents: dict[str, Extent], seconds: float, url: str
) -> dict[str, Callable[[], list[Finding]]]:
    """What is looked at, by the name under which a person sees it."""
    tasks: dict[str, Callable[[], list[Finding]]] = {}
    if files.cameras is not None:
        for name in files.cameras.cameras:
            tasks[f"camera {name}"] = partial(_check_camera, name, files, extents)
    for name, robot in files.robots.items():
        tasks[f"robot {name}"] = partial(_check_robot, name, robot, files, extents, seconds)
    tasks["perception"] = check_weights
    tasks["running system"] = partial(check_system, files, url)
    return tasks


def _check_camera(name: str, files: Files, extents: dict[str, Extent]) -> list[Finding]:
    assert files.cameras is not None
    entry = files.cameras.cameras[name]
    stream = check_stream(entry, files.cameras, _COUNT_S)
    return [stream, *_local(f"camera {name}", entry.stream), check_place(entry, files, extents.get(entry.floor))]


def _check_robot(
    name: str, robot: RobotFile, files: Files, extents: dict[str, Extent], seconds: float
) -> list[Finding]:
    where = files.shown(files.building.robots[name])
    findings = _local(f"robot {name}", robot.router)
    floors = files.cameras.floors if files.cameras else {}
    if files.cameras is not None and robot.floor not in floors:
        told = f"floor {robot.floor} isn't one of {files.shown(files.building.cameras)}: {', '.join(floors)}"
        findings.append(Finding(f"robot {name}, floor", "problem", told, f"correct `floor` in {where}"))
    elif robot.floor in floors and abs(floors[robot.floor].z_m - robot.floor_z_m) > 1e-3:
        told = f"floor_z_m is {robot.floor_z_m:g}, but floor {robot.floor} lies at {floors[robot.floor].z_m:g} m"
        findings.append(Finding(f"robot {name}, floor", "problem", told, f"correct `floor_z_m` in {where}"))
    extent = extents.get(robot.floor)

    def fault_of(x: float, y: float) -> str:
        """Why the robot can't be there."""
        if extent is None or extent.holds(x, y):
            return ""
        return f"outside the plan of floor {robot.floor} ({extent}): measure T_building_map (surveilnav robots frame {where})"

    for check in check_robot(robot, seconds, fault_of):
        findings.append(Finding(f"robot {name}, {check.part}", "ok" if check.ok else "problem", check.message))
    return findings


def _local(what: str, address: str) -> list[Finding]:
    """A note if an address means another machine in a container than it does here."""
    if not _LOCAL.search(address):
        return []
    told = "its address is this machine's own, which in a container is the container"
    return [Finding(what, "note", told, "with Docker, write this machine's address in the network")]
