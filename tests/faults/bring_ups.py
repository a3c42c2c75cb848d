"""A whole system is started and stopped; what it leaves behind is counted."""

from __future__ import annotations

import gc
import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from surveilnav.bus import Node
from surveilnav.bus.router import free_port
from surveilnav.cli.stack import Stack, environment
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings

_SHARED = Path("/dev/shm")
#: What Zenoh and Python call their shared memory. Semaphores aren't looked for: no service has any.
_SHARED_NAMES = ("zenoh", "psm_")


@dataclass(frozen=True, slots=True)
class Leftovers:
    """What this process holds, open files and sockets, threads, children; and shared memory of processes that have ended."""

    files: int
    sockets: int
    threads: int
    children: int
    shared_memory: frozenset[str]

    @classmethod
    def now(cls) -> Leftovers:
        gc.collect()
        pid = os.getpid()
        opened = [os.readlink(path) for path in Path("/proc/self/fd").iterdir() if path.is_symlink()]
        sockets = sum(name.startswith("socket:") for name in opened)
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        shared = frozenset(_abandoned_shared_memory())
        return cls(len(opened) - sockets, sockets, threading.active_count(), len(children), shared)

    def beyond(self, before: Leftovers) -> list[str]:
        """What there is more than before, in words. Two open files, sockets or threads more are nothing."""
        found = []
        for name, room in (("files", 2), ("sockets", 2), ("threads", 2), ("children", 0)):
            more = getattr(self, name) - getattr(before, name)
            if more > room:
                found.append(f"{more} {name} more")
        if more_names := self.shared_memory - before.shared_memory:
            found.append(f"shared memory: {sorted(more_names)}")
        return found


def bring_up(folder: Path, building: str = "parametric_flat") -> tuple[float, list[str]]:
    """Starts everything, waits until all are there, and stops it.

    Returns:
        The seconds that took, and what the services have left behind, in words: processes, and files in their temporary folder.
    """
    began_s = time.monotonic()
    temporary = folder / "temporary"
    temporary.mkdir(parents=True)
    home = SimulatedBuilding(SimulationSettings(building=building, cameras=1))
    home.prepare()
    variables = environment(
        router=f"tcp/127.0.0.1:{free_port()}",
        building=building,
        seed=0,
        cameras=1,
        area_per_camera_m2=100,
        perception="oracle",
        surveillance=True,
        state=folder / "state",
        recordings=folder / "recordings",
    )
    variables |= {
        "SURVEILNAV_GATEWAY__PORT": str(free_port()),
        "SURVEILNAV_SIM__LIGHTING": "flat",
        "TMPDIR": str(temporary),
    }
    names = [camera.name for camera in home.plan.cameras]
    with (
        Stack(variables, folder / "logs", names, gateway=True, recorder=True) as stack,
        Node("test", "bring-up", stack.bus, alive=False) as node,
    ):
        stack.wait_ready(node, 120)
        stack.check()
    left = [f"process of {command}" for command in _processes_with(f"TMPDIR={temporary}")]
    killed = [name for name, process in stack.processes.items() if process.returncode == -9]
    left += [f"{name} didn't end by itself" for name in killed]
    left += [f"temporary file {path.name}" for path in temporary.iterdir()]
    return time.monotonic() - began_s, left


def _abandoned_shared_memory() -> list[str]:
    """Shared memory of Zenoh and Python that no process uses."""
    names = os.listdir(_SHARED) if _SHARED.is_dir() else []
    suspects = [name for name in names if any(word in name for word in _SHARED_NAMES)]
    used = ""
    for maps in Path("/proc").glob("[0-9]*/maps") if suspects else ():
        try:
            used += "".join(line for line in maps.open() if str(_SHARED) in line)
        except OSError:
            continue
    return [name for name in suspects if name not in used]


def _processes_with(variable: str) -> list[str]:
    """The commands of all processes with that variable in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if variable.encode() in (process / "environ").read_bytes().split(b"\0"):
                found.append((process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip())
        except OSError:
            continue
    return found
