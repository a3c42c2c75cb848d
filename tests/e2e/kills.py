"""A ``surveilnav up`` whose services can be killed, seen as people see it: through the gateway and the console."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from surveilnav.bus.router import free_port
from surveilnav.messages import FINISHED_STATES
from tests.waiting import until

#: Every kind of service of `up`, and how its process is known: a module it runs, a word of its environment.
SERVICES = {
    "router": ("surveilnav.bus.router", ""),
    "perception": ("surveilnav.services.perception", ""),
    "fusion": ("surveilnav.services.fusion", ""),
    "planner": ("surveilnav.services.planner", ""),
    "robot": ("surveilnav.services.robot_node", ""),
    "camera-c0-1": ("surveilnav.services.camera_node", "SURVEILNAV_CAMERA__ID=c0-1"),
    "gateway": ("surveilnav.services.gateway", ""),
    "recorder": ("surveilnav.services.recorder", ""),
}
#: The services that /readyz asks for.
_NEEDED = ("router", "perception", "fusion", "planner", "robot")


@dataclass
class Up:
    """A running ``surveilnav up``."""

    process: subprocess.Popen[bytes]
    gateway: httpx.Client
    console: Path
    killed: bool = False

    def pid(self, name: str) -> int | None:
        """The process of a service; None while it has none."""
        module, word = SERVICES[name]
        up = self.process.pid
        for child in Path(f"/proc/{up}/task/{up}/children").read_text().split():
            try:
                command, environment = (Path(f"/proc/{child}/{f}").read_bytes() for f in ("cmdline", "environ"))
            except OSError:
                continue
            if module.encode() in command.split(b"\0") and (not word or word.encode() in environment.split(b"\0")):
                return int(child)
        return None

    def kill(self, name: str) -> float:
        """SIGKILL, as a power cut would; the seconds until the service is back: another process, and heard of."""
        dead = self.pid(name)
        assert dead is not None, f"{name} doesn't run"
        os.kill(dead, signal.SIGKILL)
        began_s = time.monotonic()
        until(
            lambda: self.pid(name) not in (dead, None) and self._heard(name),
            lambda: f"{name} isn't back: {self.said}",
            60,
        )
        return time.monotonic() - began_s

    def kill_itself(self) -> None:
        """SIGKILL to ``up``; returns when all of its services have ended."""
        pids = [pid for name in SERVICES if (pid := self.pid(name)) is not None]
        assert len(pids) == len(SERVICES), self.said
        self.process.kill()
        self.killed = True
        until(lambda: not any(_runs(pid) for pid in pids), "services outlive `up`", 20)

    def _heard(self, name: str) -> bool:
        """Whether the gateway says that a service is there."""
        try:
            if name.startswith("camera"):
                cameras = self.gateway.get("/api/v1/cameras").json()["items"]
                return any(name == f"camera-{c['id']}" and not c["stale"] for c in cameras)
            if name == "recorder":
                return any(not r["stale"] for r in self.gateway.get("/api/v1/recorders").json()["items"])
            ready = self.gateway.get("/readyz").json()
            if name == "perception":
                workers = self.gateway.get("/api/v1/perception").json()["items"]
                return bool(ready.get("ready")) and all(w["ready"] and not w["stale"] for w in workers)
            return bool(ready.get("ready"))
        except (httpx.HTTPError, KeyError):
            return False

    def search(self, target: str) -> str:
        """The id of a mission that was begun; asked again until there is a robot for it."""
        answer = until(
            lambda: (a := self.gateway.post("/api/v1/missions", json={"target": target})).status_code == 202 and a,
            timeout_s=30,
        )
        return str(answer.json()["id"])

    def mission(self, id: str) -> dict[str, Any]:
        """A mission as the gateway tells of it; empty while it can't."""
        try:
            answer = self.gateway.get(f"/api/v1/missions/{id}")
        except httpx.HTTPError:
            return {}
        return dict(answer.json()) if answer.status_code == 200 else {}

    def goes_on(self, id: str, steps: int) -> bool:
        """Whether a mission makes ``steps`` more from now on: False once it is over."""
        goal, last = 0, {}

        def moved() -> bool:
            nonlocal goal, last
            last = self.mission(id) or last
            goal = goal or (last["step"] + steps if last else 0)
            return bool(last) and (last["step"] >= goal or last["state"] in FINISHED_STATES)

        until(moved, lambda: f"it stands still: {last}\n{self.said}", 60)
        return last["state"] not in FINISHED_STATES

    def end(self, id: str, timeout_s: float = 120) -> dict[str, Any]:
        """The mission when it is over."""
        last: dict[str, Any] = {}

        def over() -> bool:
            nonlocal last
            last = self.mission(id) or last
            return last.get("state") in FINISHED_STATES

        until(over, lambda: f"not over: {last}\n{self.said}", timeout_s)
        return last

    def services(self) -> dict[str, dict[str, Any]]:
        """What the gateway knows of restarts, by service."""
        return {s["id"]: s for s in self.gateway.get("/api/v1/services").json()["items"]}

    @property
    def said(self) -> str:
        """The console so far."""
        return self.console.read_text()


def _runs(pid: int) -> bool:
    """Whether a process is there; one that ended and that nobody waited for isn't."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@contextmanager
def up(
    folder: Path,
    building: str = "parametric_flat",
    perception: str = "oracle",
    cameras: int = 2,
    host: str = "127.0.0.1",
    program: tuple[str, ...] = (sys.executable, "-m", "surveilnav.cli.main"),
    more: dict[str, str] | None = None,
) -> Iterator[Up]:
    """Starts ``surveilnav up`` and waits until it is ready; stopped at the end.

    Args:
        folder: for its console, logs and state.
        host: where the router listens.
        program: what runs the command line. ``more``: variables of its environment.
    """
    folder.mkdir(parents=True, exist_ok=True)
    port, console = free_port(), folder / "console.txt"
    command = [
        *program,
        "up",
        "--building",
        building,
        "--perception",
        perception,
        "--cameras",
        str(cameras),
        "--port",
        str(port),
        "--router",
        f"tcp/{host}:{free_port()}",
        "--logs",
        str(folder / "logs"),
    ]
    environment = os.environ | {"SURVEILNAV_SIM__LIGHTING": "flat", "COLUMNS": "200"} | (more or {})
    with console.open("wb") as out:
        process = subprocess.Popen(command, stdout=out, stderr=out, stdin=subprocess.DEVNULL, env=environment)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=10) as gateway:
            system = Up(process, gateway, console)
            until(lambda: process.poll() is not None or "ready: http" in system.said, lambda: system.said, 120)
            assert process.poll() is None, system.said
            until(lambda: system._heard("robot"), timeout_s=30)
            yield system
            assert process.poll() is None or system.killed, system.said
    finally:
        process.terminate()
        process.wait(30)
