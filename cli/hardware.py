"""The cameras and the robot of a simulated building as hardware: processes that are met by RTSP and ROS 2 alone."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path
from types import TracebackType

from surveilnav.bus.router import free_port
from surveilnav.cli.stack import launch, terminate
from surveilnav.errors import SurveilNavError
from surveilnav.perception.names import BackendName

_PACKAGE = "surveilnav.simulator.hardware"
#: Rendering what the cameras see takes seconds for each that isn't in the cache.
_READY_S = 600.0
#: Where the robot's map lies in the building, unless the environment says so: somewhere else, and turned.
_MAP = {
    "SURVEILNAV_ROBOT_HARDWARE__MAP_X_M": "1.3",
    "SURVEILNAV_ROBOT_HARDWARE__MAP_Y_M": "-0.7",
    "SURVEILNAV_ROBOT_HARDWARE__MAP_YAW_DEG": "35",
}


class Hardware:
    """Use it as a context manager; inside, cameras and robot are ready, and ``building_file`` describes them.

    Args:
        variables: the environment variables by which the building is chosen, among others.
        folder: where the files that describe the hardware go, and its logs.
    """

    def __init__(self, variables: dict[str, str], folder: Path) -> None:
        self._folder = folder.resolve()
        port = free_port()
        self.rtsp, self.ros_router = f"rtsp://127.0.0.1:{port}", f"tcp/127.0.0.1:{free_port()}"
        self.building_file = self._folder / "hardware" / "building.yaml"
        maps = {name: os.environ.get(name, value) for name, value in _MAP.items()}
        self._variables = variables | maps
        self._variables |= {"SURVEILNAV_ROBOT_HARDWARE__ROUTER": self.ros_router}
        self._variables |= {"SURVEILNAV_CAMERA_HARDWARE__PORT": str(port)}
        self._backend = variables["SURVEILNAV_PERCEPTION__BACKEND"]
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def settings(self) -> dict[str, str]:
        """The services' settings that lead them to this hardware, as environment variables."""
        files = self.building_file.parent
        cameras = str(files / "cameras.yaml")
        return {
            "SURVEILNAV_CAMERA__FILE": cameras,
            "SURVEILNAV_GATEWAY__CAMERAS_FILE": cameras,
            # good on rendered pictures, which these are
            "SURVEILNAV_CAMERA__DEPTH": os.environ.get("SURVEILNAV_CAMERA__DEPTH", "network"),
            "SURVEILNAV_ROBOT__FILE": str(files / "robots" / "r1.yaml"),
            "SURVEILNAV_PERCEPTION__SIMULATED": "false",
            "SURVEILNAV_PERCEPTION__BACKEND": BackendName.COMPACT if self._backend == "auto" else self._backend,
        }

    def __enter__(self) -> Hardware:
        try:
            self._start(
                "hardware-describe", f"{_PACKAGE}.describe", str(self.building_file.parent), "--rtsp", self.rtsp
            )
            self._wait("hardware-describe", "describes")
            self._start("hardware-router", "surveilnav.bus.router", "--listen", self.ros_router)
            self._start("hardware-robot", f"{_PACKAGE}.ros2_robot")
            self._start("hardware-cameras", f"{_PACKAGE}.rtsp_cameras")
            self._wait("hardware-robot", "the robot is ready")
            self._wait("hardware-cameras", "the cameras are ready")
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._stop()

    def _start(self, name: str, module: str, *arguments: str) -> None:
        log = self._log(name)
        log.unlink(missing_ok=True)  # what it said before would count as said now
        self.processes[name] = launch(module, arguments, self._variables, log)

    def _wait(self, name: str, word: str) -> None:
        """Waits until a process has said a word."""
        deadline_s = time.monotonic() + _READY_S
        while word not in (said := self._log(name).read_text(errors="replace")):
            if self.processes[name].poll() is not None or time.monotonic() > deadline_s:
                tail = "\n  ".join(said.strip().splitlines()[-8:]) or "(nothing)"
                raise SurveilNavError(f"the simulated hardware can't start; {name} says:\n  {tail}")
            time.sleep(0.05)

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _stop(self) -> None:
        terminate([p for name, p in self.processes.items() if name != "hardware-router"])
        terminate([p for name, p in self.processes.items() if name == "hardware-router"])
