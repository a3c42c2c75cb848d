"""The running system, asked by its gateway: whether each camera and robot of the files has a process, and whether all is well."""

from __future__ import annotations

from shlex import quote

from surveilnav.cli.building_check.files import Files
from surveilnav.cli.finding import Finding
from surveilnav.cli.traffic import MAX_CLOCK_OFFSET_S, clock_words
from surveilnav.client import Client
from surveilnav.errors import GatewayError
from surveilnav.rest import Camera, NodeTraffic, Robot

_TIMEOUT_S = 5.0
#: What a building needs besides its cameras and robots.
_KINDS = ("perception", "fusion", "planner")
_LOGS = "docker compose logs"


def check_system(files: Files, url: str) -> list[Finding]:
    """Asks the gateway. That no system runs is only noted."""
    try:
        with Client(url, timeout_s=_TIMEOUT_S) as asked:
            nodes, cameras, robots = asked.traffic().nodes, asked.cameras(), asked.robots()
    except GatewayError as error:
        if error.name == "no_gateway":
            override = files.path.parent / "compose.override.yaml"
            start = f"docker compose -f compose.building.yaml -f {quote(str(override))} up --wait"
            return [Finding("running system", "note", f"none answers at {url}", start)]
        return [Finding("running system", "problem", str(error), "put a key into SURVEILNAV_API_KEY")]
    findings = [*_nodes(nodes), *_cameras(files, cameras), *_robots(files, robots)]
    told = f"{len(nodes)} processes answer at {url}"
    return findings or [Finding("running system", "ok", f"{told}; their clocks agree to {MAX_CLOCK_OFFSET_S:g} s")]


def _nodes(nodes: list[NodeTraffic]) -> list[Finding]:
    found = []
    alive = [node for node in nodes if not node.stale]
    for kind in _KINDS:
        if not any(node.kind == kind for node in alive):
            found.append(Finding("running system", "problem", f"no {kind} runs", f"{_LOGS} {kind}"))
    for node in alive:
        what = f"process {node.kind}/{node.id}"
        if abs(node.clock_offset_s or 0.0) > MAX_CLOCK_OFFSET_S:
            told = f"its clock is {clock_words(node.clock_offset_s)[0]} of the gateway's"
            found.append(Finding(what, "problem", told, "have NTP set the clock of its machine (timedatectl)"))
        if node.other_release:
            told = f"it runs release {node.release or 'unknown'}, the gateway another one"
            found.append(Finding(what, "note", told, "docker compose up --wait"))
        found += [
            Finding(what, "problem", f"{name}: {why}", f"{_LOGS} {node.kind}") for name, why in node.problems.items()
        ]
    return found


def _cameras(files: Files, running: list[Camera]) -> list[Finding]:
    found = []
    by_id = {camera.id: camera for camera in running if not camera.stale}
    for name in files.cameras.cameras if files.cameras else ():
        what = f"camera {name}, running"
        camera = by_id.get(name)
        if camera is None:
            remedy = (
                "start as many camera containers as the file has cameras (deploy.replicas in compose.override.yaml)"
            )
            found.append(Finding(what, "problem", "no process runs it", remedy))
        elif camera.paused:
            found.append(Finding(what, "note", "it is paused", f"surveilnav cameras resume {name}"))
        elif camera.quarantine:
            found.append(Finding(what, "problem", f"it isn't believed: {camera.quarantine}", "calibrate it anew"))
        elif camera.stream.state not in ("live", "connecting"):
            told = f"{camera.stream.state}: {camera.stream.reason}" if camera.stream.reason else camera.stream.state
            found.append(Finding(what, "problem", told, f"{_LOGS} camera"))
    return found


def _robots(files: Files, running: list[Robot]) -> list[Finding]:
    found = []
    by_id = {robot.id: robot for robot in running if not robot.stale}
    for name in files.robots:
        if name not in by_id:
            told = "no process runs it, or it has sent no picture yet"
            found.append(Finding(f"robot {name}, running", "problem", told, f"{_LOGS} robot"))
    return found
