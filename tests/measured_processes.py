"""Processes of a running system whose costs a benchmark reads from /proc."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.waiting import until


@dataclass(frozen=True)
class MeasuredProcess:
    """A process of the system."""

    name: str
    process: subprocess.Popen[bytes]

    def cpu_s(self) -> float:
        """The time that it has spent on processors [s], which other load doesn't change much."""
        return cpu_s(self.process.pid)

    def memory_mib(self) -> float:
        return memory_mib(self.process.pid)


def cpu_s(pid: int) -> float:
    """User and system time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mib(pid: int) -> float:
    """Resident memory of a process."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


@contextlib.contextmanager
def processes(
    commands: Mapping[str, Sequence[str]], environment: Mapping[str, str], folder: str
) -> Iterator[dict[str, MeasuredProcess]]:
    """Runs Python modules with arguments, by name, each once its health file says that the one before works.

    A router has no health file: it counts as working after two seconds.
    """
    running: dict[str, MeasuredProcess] = {}
    try:
        for name, command in commands.items():
            health = Path(folder) / f"{name}.healthy"
            own = {**os.environ, **environment, "SURVEILNAV_BUS__HEALTH_FILE": str(health)}
            process = subprocess.Popen([sys.executable, "-m", *command], env=own, cwd=folder)
            running[name] = MeasuredProcess(name, process)
            if name == "router":
                time.sleep(2.0)
            else:
                until(health.exists, f"{name} isn't healthy", 120.0)
        yield running
    finally:
        for measured in reversed(running.values()):
            measured.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                measured.process.wait(20)
            measured.process.kill()
            measured.process.wait()
