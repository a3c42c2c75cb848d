"""A simulated robot as hardware: its own router and its ROS 2 process, and the robot file that describes it."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

from surveilnav.benchmark.studies.as_real import Truth
from surveilnav.bus.router import free_port, open_router
from surveilnav.robot_state import RobotState
from surveilnav.ros2.session import RosSession
from tests.waiting import until

#: Where the robot's map lies in the building: somewhere else, and turned.
MAP_X_M, MAP_Y_M, MAP_YAW_DEG = 1.3, -0.7, 35.0


@dataclass
class Hardware:
    """The robot's process and its file."""

    process: subprocess.Popen[bytes]
    router: str
    file: Path
    log: Path


@contextmanager
def robot_hardware(
    folder: Path, building: str, start: str, host: str = "127.0.0.1", **settings: object
) -> Iterator[Hardware]:
    """Runs a robot in a building, with its router at ``host``.

    Args:
        start: x,y,floor,yaw_deg.
        settings: of ``RobotHardwareSettings``.
    """
    endpoint = f"tcp/{host}:{free_port()}"
    facts = {
        "router": endpoint,
        "start": start,
        "map_x_m": MAP_X_M,
        "map_y_m": MAP_Y_M,
        "map_yaw_deg": MAP_YAW_DEG,
    } | settings
    variables = {f"SURVEILNAV_ROBOT_HARDWARE__{name.upper()}": str(value) for name, value in facts.items()}
    variables["SURVEILNAV_SIM__BUILDING"] = building
    log = folder / "robot_hardware.log"
    with open_router(endpoint), log.open("ab") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "surveilnav.simulator.hardware.ros2_robot"],
            env={**os.environ, **variables},
            stdout=out,
            stderr=out,
        )
        try:
            yield Hardware(process, endpoint, write_robot_file(folder / "robot.yaml", endpoint), log)
        finally:
            process.terminate()
            process.wait(10)


def true_state(router: str) -> RobotState:
    """Where the robot is in truth, which nobody but a test may know: it stands there, on a floor at altitude 0."""
    truth = Truth()
    with RosSession("judge", router=router) as session:
        session.subscribe("/ground_truth", "nav_msgs/msg/Odometry", truth.on_odometry)
        pose = until(lambda: truth.pose)
    assert pose is not None
    return RobotState(pose[0], pose[1], 0.0, truth.floor, pose[2], stopped=True)


def write_robot_file(path: Path, router: str, **changes: object) -> Path:
    """The file of that robot. ``changes``: entries that differ; None leaves one out."""
    entries = {
        "router": router,
        "floor": "0",
        "T_building_map": {"x_m": MAP_X_M, "y_m": MAP_Y_M, "yaw_deg": MAP_YAW_DEG},
        "depth_range_m": [0.5, 5.0],
    } | changes
    path.write_text(yaml.safe_dump({k: v for k, v in entries.items() if v is not None}, sort_keys=False))
    return path


def in_map(x_m: float, y_m: float) -> tuple[float, float]:
    """A place of the building in the robot's map."""
    a, dx, dy = math.radians(MAP_YAW_DEG), x_m - MAP_X_M, y_m - MAP_Y_M
    return math.cos(a) * dx + math.sin(a) * dy, -math.sin(a) * dx + math.cos(a) * dy
