"""A whole system is started and stopped; what it leaves behind is counted."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from surveilnav.bus import Node
from surveilnav.bus.router import free_port
from surveilnav.cli.stack import Stack, environment
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


@dataclass(frozen=True, slots=True)
class Leftovers:
    """What this process and the machine hold: files that are open, threads, children, shared memory, temporary files."""

    files: int
    threads: int
    children: int
    shared_memory: frozenset[str]
    temporary: frozenset[str]

    @classmethod
    def now(cls) -> Leftovers:
        pid = os.getpid()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        shared = Path("/dev/shm")
        return cls(
            len(os.listdir("/proc/self/fd")),
            threading.active_count(),
            len(children),
            frozenset(name for name in os.listdir(shared) if "zenoh" in name or "sem" in name)
            if shared.is_dir()
            else frozenset(),
            frozenset(n for n in os.listdir(tempfile.gettempdir()) if "surveilnav" in n or "zenoh" in n),
        )

    def beyond(self, before: Leftovers, room: int = 2) -> list[str]:
        """What there is more than before, in words. ``room``: so many open files and threads more are nothing."""
        found = []
        for name in ("files", "threads", "children"):
            more = getattr(self, name) - getattr(before, name)
            if more > (0 if name == "children" else room):
                found.append(f"{more} {name} more")
        for name in ("shared_memory", "temporary"):
            if more_names := getattr(self, name) - getattr(before, name):
                found.append(f"{name}: {sorted(more_names)}")
        return found


def bring_up(folder: Path, building: str = "parametric_flat") -> float:
    """Starts everything, waits until all are there, and stops it; returns the seconds that took."""
    began_s = time.monotonic()
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
    ) | {"SURVEILNAV_GATEWAY__PORT": str(free_port()), "SURVEILNAV_SIM__LIGHTING": "flat"}
    names = [camera.name for camera in home.plan.cameras]
    with (
        Stack(variables, folder / "logs", names, gateway=True, recorder=True) as stack,
        Node("test", "bring-up", stack.bus, alive=False) as node,
    ):
        stack.wait_ready(node, 120)
        stack.check()
    left = [name for name, process in stack.processes.items() if process.poll() is None]
    assert not left, f"they outlive the system: {left}"
    return time.monotonic() - began_s
