"""The whole system as processes of this machine: started in order, watched, stopped together."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import ENDS_WITH_STDIN
from surveilnav.errors import SurveilNavError
from surveilnav.security.folder import ACCESS, CA, CERTIFICATE, KEY, SecurityFolder
from surveilnav.services.gateway.core.resources import NEEDED

_SOON_S = 5.0
#: A file system in memory, on Linux.
_IN_MEMORY = Path("/dev/shm")
_HANDOVER_FOLDER = "SURVEILNAV_BUS__HANDOVER_FOLDER"
#: The setting by which several fusion services share a building.
_SHARDS = "SURVEILNAV_FUSION__SHARDS"
#: Services that are stopped have this long to end by themselves, as in containers: on a busy machine 5 s were too few.
_GRACE_S = 10.0
_WHY_LATE = "; after an installation they compile their loops for half a minute"


@dataclass(frozen=True, slots=True)
class _Program:
    """What a service's process runs: a module with arguments, and what its environment has beside the stack's."""

    module: str
    arguments: tuple[str, ...] = ()
    more: dict[str, str] = field(default_factory=dict)


@dataclass
class Stack:
    """Router and services below one settings environment. Use it as a context manager.

    ``environment`` goes to every process; logs land in ``log_dir``, one file a service. ``searches`` False: router and gateway
    alone, somebody else stands in for the rest. ``security``: has an identity for each of them; None: no security.
    """

    environment: dict[str, str]
    log_dir: Path
    cameras: list[str] = field(default_factory=list)
    gateway: bool = False
    recorder: bool = False
    searches: bool = True
    security: SecurityFolder | None = None
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    _handover_folder: str = ""  # that was made for these processes

    @property
    def bus(self) -> BusSettings:
        """How a client comes onto the stack's bus."""
        files = self.security.identity_folder("supervisor") if self.security else None
        return BusSettings(
            router=self.environment["SURVEILNAV_BUS__ROUTER"],
            building=self.environment["SURVEILNAV_BUS__BUILDING"],
            tls_ca=files and files / CA,
            tls_certificate=files and files / CERTIFICATE,
            tls_key=files and files / KEY,
        )

    def __enter__(self) -> Stack:
        self.log_dir.mkdir(parents=True, exist_ok=True)
        if _IN_MEMORY.is_dir() and _HANDOVER_FOLDER not in {**os.environ, **self.environment}:
            self._handover_folder = tempfile.mkdtemp(prefix="surveilnav-", dir=_IN_MEMORY)
            self.environment = {**self.environment, _HANDOVER_FOLDER: self._handover_folder}
        try:
            for name in self._programs():
                self.start(name)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.stop()

    def _programs(self) -> dict[str, _Program]:
        """All of the stack by name, in the order of their start."""
        access = ("--access", str(self.security.path / ACCESS)) if self.security else ()
        listen = ("--listen", self.environment["SURVEILNAV_BUS__ROUTER"], *access)
        programs = {"router": _Program("surveilnav.bus.router", listen)}
        if self.searches:
            names = ("perception", *self._fusions(), "planner")
            programs |= {name: _Program(f"surveilnav.services.{name.partition('-')[0]}") for name in names}
            programs["robot"] = _Program("surveilnav.services.robot_node")
        for camera in self.cameras:
            programs[f"camera-{camera}"] = _Program(
                "surveilnav.services.camera_node", more={"SURVEILNAV_CAMERA__ID": camera}
            )
        if self.gateway:
            programs["gateway"] = _Program("surveilnav.services.gateway")
        if self.recorder:
            programs["recorder"] = _Program("surveilnav.services.recorder")
        return programs

    def _fusions(self) -> list[str]:
        """The names of the processes of fusion: one, or as many as the building has shards."""
        shards = {**os.environ, **self.environment}.get(_SHARDS)
        try:
            n_shards = len(json.loads(shards)) if shards else 0
        except (ValueError, TypeError):  # fusion itself says what is wrong with them
            n_shards = 0
        return [f"fusion-{number}" for number in range(1, n_shards + 1)] or ["fusion"]

    def start(self, name: str) -> None:
        """Starts (again) the service of that name."""
        program = self._programs()[name]
        variables = {**self.environment, **program.more, **self._identity(name)}
        self.processes[name] = launch(program.module, program.arguments, variables, self.log_of(name))

    def _identity(self, name: str) -> dict[str, str]:
        """The environment variables by which the service of that name has its identity."""
        if self.security is None:
            return {}
        identity = f"robot-{self.environment.get('SURVEILNAV_ROBOT__ID', 'r1')}" if name == "robot" else name
        if name in self._fusions():
            identity = "fusion"
        names = self.security.names()
        if identity.startswith("camera-") and identity not in names and "cameras" in names:
            identity = "cameras"
        folder = self.security.identity_folder(identity)
        return {
            "SURVEILNAV_BUS__TLS_CA": str(folder / CA),
            "SURVEILNAV_BUS__TLS_CERTIFICATE": str(folder / CERTIFICATE),
            "SURVEILNAV_BUS__TLS_KEY": str(folder / KEY),
        }

    def can_do_without(self, name: str) -> bool:
        """Whether the rest can search without that service: a camera, the recorder."""
        return name.startswith("camera-") or name == "recorder"

    def log_of(self, name: str) -> Path:
        """The file that the service of that name logs to."""
        return self.log_dir / f"{name}.log"

    def log_tail(self, name: str) -> str:
        """The last lines of a service's log, for people."""
        lines = self.log_of(name).read_text(errors="replace").strip().splitlines()
        return "\n  ".join(lines[-8:]) or "(its log is empty)"

    def wait_ready(self, node: Node, timeout_s: float, progress: Callable[[str], None] = lambda text: None) -> None:
        """Waits until every service is on the bus.

        Raises:
            SurveilNavError: a process ended, or not all came in time; with the end of its log.
        """
        began_s = time.monotonic()
        while missing := self._missing(node):
            self.check()
            if time.monotonic() > began_s + timeout_s:
                raise SurveilNavError(
                    f"after {timeout_s:g} s these services aren't on the bus: {', '.join(missing)}; "
                    f"their logs are in {self.log_dir}"
                )
            late = time.monotonic() > began_s + _SOON_S
            progress(f"waiting for {', '.join(missing)}" + (_WHY_LATE if late else ""))
            time.sleep(0.1)

    def _missing(self, node: Node) -> list[str]:
        """What isn't on the bus yet."""
        kinds: list[str] = [kind for kind, _ in NEEDED] if self.searches else []
        kinds += [name for name, wanted in (("gateway", self.gateway), ("recorder", self.recorder)) if wanted]
        missing = [kind for kind in kinds if not node.alive(kind)]
        if self.searches and 0 < len(node.alive("fusion")) < len(self._fusions()):
            missing.append("fusion for every shard")
        present = node.alive("camera")
        return missing + [f"camera {c}" for c in self.cameras if c not in present]

    def check(self) -> None:
        """Raises if a process has ended by itself, with the last lines of its log."""
        for name, process in self.processes.items():
            if (code := process.poll()) is not None:
                tail = self.log_tail(name)
                raise SurveilNavError(f"{name} ended with exit code {code}. The end of its log:\n  {tail}")

    def stop(self) -> None:
        """SIGTERM to all but the router, then the router; SIGKILL to what doesn't go."""
        services = [p for name, p in self.processes.items() if name != "router"]
        terminate(services)
        terminate([p for name, p in self.processes.items() if name == "router"])
        if self._handover_folder:
            shutil.rmtree(self._handover_folder, ignore_errors=True)


def launch(module: str, arguments: Sequence[str], variables: dict[str, str], log: Path) -> subprocess.Popen[bytes]:
    """Starts a module as a process that ends with this one. ``variables``: added to this process's environment."""
    with log.open("ab") as out:
        return subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            env={**os.environ, **variables, ENDS_WITH_STDIN: "1"},
            # Nobody writes to it: it breaks when this process is gone, also by `kill -9`, and the service ends.
            stdin=subprocess.PIPE,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )


def terminate(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """SIGTERM to all, and SIGKILL to what doesn't go in time."""
    for process in processes:
        if process.poll() is None:
            process.terminate()
    deadline_s = time.monotonic() + _GRACE_S
    for process in processes:
        try:
            process.wait(timeout=max(0.1, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def environment(
    *,
    router: str,
    building: str,
    seed: int,
    cameras: int | None,
    area_per_camera_m2: float,
    perception: str,
    surveillance: bool,
    state: Path,
    recordings: Path = Path("runs/recordings"),
    cameras_everywhere: bool = False,
    robot_start: str = "",
) -> dict[str, str]:
    """The settings of a stack as environment variables. ``state``: where maps, missions and the robot's place are kept.
    ``recordings``: where they go, unless the environment says so."""
    settings = {
        "SURVEILNAV_BUS__ROUTER": router,
        "SURVEILNAV_BUS__BUILDING": bus_name(building),
        "SURVEILNAV_SIM__BUILDING": building,
        "SURVEILNAV_SIM__SEED": str(seed),
        "SURVEILNAV_SIM__AREA_PER_CAMERA_M2": str(area_per_camera_m2),
        "SURVEILNAV_SIM__CAMERAS_EVERYWHERE": str(cameras_everywhere).lower(),
        "SURVEILNAV_PERCEPTION__BACKEND": perception,
        "SURVEILNAV_PERCEPTION__SIMULATED": "true",
        "SURVEILNAV_PERCEPTION__SEED": str(seed),
        # With what a camera looks for its summary; it does so only in buildings of more than one floor, where the
        # planner has a floor to choose. SURVEILNAV_CAMERA__PERCEPTION in the environment is stronger: "none" spares
        # the cameras' processors, and every floor is then as promising as the other.
        "SURVEILNAV_CAMERA__PERCEPTION": os.environ.get("SURVEILNAV_CAMERA__PERCEPTION", perception),
        "SURVEILNAV_FUSION__SURVEILLANCE": str(surveillance).lower(),
        "SURVEILNAV_FUSION__STORE": str(state.resolve() / "fusion.sqlite"),
        "SURVEILNAV_PLANNER__STORE": str(state.resolve() / "planner.sqlite"),
        "SURVEILNAV_ROBOT__STORE": str(state.resolve() / "robot.state"),
        "SURVEILNAV_ROBOT__START": robot_start,
        "SURVEILNAV_RECORDER__FOLDER": os.environ.get("SURVEILNAV_RECORDER__FOLDER", str(recordings.resolve())),
        # Two cores: every process with a pool of its own would only wait for the others.
        "OMP_NUM_THREADS": "2",
        "OPENBLAS_NUM_THREADS": "1",
    }
    if cameras is not None:
        settings["SURVEILNAV_SIM__CAMERAS"] = str(cameras)
    return settings


def bus_name(building: str) -> str:
    """A building's name as it can stand in a key."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "-" for c in Path(building).stem)
    return name.strip("-_") or "building"
