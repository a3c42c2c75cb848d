"""A ``surveilnav up`` to which faults happen: services that are started by way of a wrapper, stores on a small disk."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.e2e.kills import SERVICES, Up, up
from tests.waiting import until

#: The services' own network, where they can be cut off: its name, and the addresses outside and inside. Each process that runs
#: the faults has one of its own, so that two may run on a machine.
_NUMBER = os.getpid() % 16000
NETWORK = f"surveilnav-faults-{_NUMBER}"
OUTSIDE, INSIDE = (f"10.231.{_NUMBER // 64}.{_NUMBER % 64 * 4 + host}" for host in (1, 2))
_VETH = f"svf{_NUMBER}o", f"svf{_NUMBER}i"
_DISK_MB = 512
#: Every service is started by this program, which puts before it what a file of the service's name says.
_WRAPPER = """#!/bin/sh
for word in "$@"; do case "$word" in surveilnav.*) name="${{word##*.}}" ;; esac; done
if [ -e "{folder}/$name" ]; then exec $(cat "{folder}/$name") "{python}" "$@"; fi
exec "{python}" "$@"
"""

#: `surveilnav up`, whose services are started by another program, and after each death as soon as after the first: here
#: they die more often than in any building.
_RUN = """
import functools, sys
from surveilnav.cli import supervisor
from surveilnav.cli.main import main
supervisor.RestartPolicy = functools.partial(supervisor.RestartPolicy, settled_s=0.0)
sys.executable = sys.argv.pop(1)
main()
"""


def is_root() -> bool:
    return os.geteuid() == 0


def why_no_network() -> str:
    """Why no network can be made here; "" if one can."""
    if not is_root() or shutil.which("ip") is None:
        return "needs root and the command ip (iproute2)"
    made = subprocess.run(["ip", "netns", "add", f"{NETWORK}-try"], capture_output=True, text=True)
    subprocess.run(["ip", "netns", "del", f"{NETWORK}-try"], capture_output=True)
    return made.stderr.strip()


def faketime() -> Path | None:
    """The library libfaketime (the Debian package of that name); None where it isn't installed."""
    return next(iter(sorted(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"))), None)


@dataclass
class Faulty:
    """The running system, and what can be done to it.

    Attributes:
        system: as people see it.
        folder: its logs and state, on a small disk if ``has_small_disk``.
        n_searches: how many searches it was asked for.
    """

    system: Up
    folder: Path
    wrappers: Path
    has_small_disk: bool
    has_network: bool
    n_searches: int = 0

    @property
    def state(self) -> Path:
        """The folder of the stores."""
        return next((self.folder / "logs" / "state").glob("*/fusion.sqlite")).parent

    def freeze(self, name: str, seconds: float) -> float:
        """Stops a service for some seconds; returns how long afterwards it was until the gateway heard of it."""
        pid = self.system.pid(name)
        assert pid is not None, f"{name} doesn't run"
        os.kill(pid, signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            os.kill(pid, signal.SIGCONT)
        return self.time_until_heard(name)

    def time_until_heard(self, name: str) -> float:
        """Seconds until the gateway says that a service is there."""
        began_s = time.monotonic()
        until(lambda: self.system._heard(name), lambda: f"nobody hears of {name}: {self.system.said}", 90)
        return time.monotonic() - began_s

    def wrap(self, name: str, prefix: str) -> float:
        """Has a service started again with ``prefix`` before its command; "": as ever. Seconds until it is back."""
        module = SERVICES[name][0].rpartition(".")[2]
        file = self.wrappers / module
        file.write_text(prefix) if prefix else file.unlink(missing_ok=True)
        return self.system.kill(name)

    def cut(self, seconds: float) -> None:
        """Takes the network from the services in it for some seconds."""
        for state, pause_s in (("down", seconds), ("up", 0.0)):
            _ip("netns", "exec", NETWORK, "ip", "link", "set", _VETH[1], state)
            time.sleep(pause_s)

    @contextmanager
    def full_disk(self) -> Iterator[None]:
        """The disk of the stores has no room."""
        filler = self.folder / "logs" / "state" / "filler"
        with filler.open("wb", buffering=0) as file:
            for size in (1 << 20, 4096):
                try:
                    while file.write(bytes(size)):
                        pass
                except OSError:
                    continue
        try:
            yield
        finally:
            filler.unlink()

    def corrupt(self, store: str) -> None:
        """Overwrites the middle of a store, as a failing disk would."""
        path = self.state / store
        size = path.stat().st_size
        with path.open("r+b") as file:
            file.seek(size // 3)
            file.write(os.urandom(max(size // 3, 64)))
        for log in (path.with_name(f"{store}-wal"), path.with_name(f"{store}-shm")):
            log.unlink(missing_ok=True)

    def forget_maps(self) -> None:
        """Has fusion begin with empty maps, so that the next search explores again."""
        for file in self.state.glob("fusion.sqlite*"):
            file.unlink()
        self.system.kill("fusion")

    def damaged_stores(self) -> list[str]:
        """What SQLite says about the stores; nothing if all are right."""
        found = []
        for path in sorted(self.state.glob("*.sqlite")):
            try:
                with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=10.0)) as store:
                    (answer,) = store.execute("PRAGMA quick_check(1)").fetchone()
                found += [] if answer == "ok" else [f"{path.name}: {answer[:200]}"]
            except sqlite3.DatabaseError as error:
                found.append(f"{path.name}: {error}")
        return found


@contextmanager
def faulty(folder: Path, perception: str = "oracle") -> Iterator[Faulty]:
    """Starts a system to which faults can happen; nothing of it is left at the end."""
    wrappers = folder / "wrappers"
    wrappers.mkdir(parents=True)
    shim = folder / "python"
    shim.write_text(_WRAPPER.format(folder=wrappers, python=sys.executable))
    shim.chmod(0o755)
    with ExitStack() as stack:
        has_network = not why_no_network()
        if has_network:
            stack.enter_context(_network())
        if is_root():
            stack.enter_context(_small_disk(folder / "logs" / "state"))
        host = OUTSIDE if has_network else "127.0.0.1"
        program = (sys.executable, "-c", _RUN, str(shim))
        more = {
            "SURVEILNAV_PLANNER__LATE_S": "1",
            "SURVEILNAV_RECORDER__FOLDER": str(folder / "logs" / "state" / "recordings"),
        }
        system = stack.enter_context(up(folder, perception=perception, host=host, program=program, more=more))
        yield Faulty(system, folder, wrappers, is_root(), has_network)


@contextmanager
def _small_disk(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={_DISK_MB}m", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


@contextmanager
def _network() -> Iterator[None]:
    outer, inner = _VETH
    _ip("netns", "add", NETWORK)
    try:
        _ip("link", "add", outer, "type", "veth", "peer", "name", inner, "netns", NETWORK)
        _ip("addr", "add", f"{OUTSIDE}/30", "dev", outer)
        _ip("link", "set", outer, "up")
        _ip("netns", "exec", NETWORK, "ip", "addr", "add", f"{INSIDE}/30", "dev", inner)
        for device in (inner, "lo"):
            _ip("netns", "exec", NETWORK, "ip", "link", "set", device, "up")
        yield
    finally:
        _ip("netns", "del", NETWORK)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)
