"""What robots report of themselves that the maps need: positions, before the maps hold anything of a floor, and heights."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from surveilnav.messages import FrameHeader, RobotStatus

_MAX_FLOORS = 64  # since a robot may send any number of floor names


@dataclass(frozen=True, slots=True)
class RobotPosition:
    """Where a robot says that it is [m, world]; ``z_m`` is the altitude of the floor below it."""

    x_m: float
    y_m: float
    z_m: float


class RobotPositions:
    """The latest position of any robot on each floor. Safe to read from any thread."""

    def __init__(self) -> None:
        self._by_floor: dict[str, RobotPosition] = {}

    def record(self, header: FrameHeader) -> None:
        """Records where an observation of a robot was made. Frames of cameras are ignored, and floors beyond the limit, too."""
        has_room = header.floor in self._by_floor or len(self._by_floor) < _MAX_FLOORS
        if header.source.startswith("robot/") and has_room:
            x_m, y_m, z_m = header.T_world_camera.translation_m
            self._by_floor[header.floor] = RobotPosition(x_m, y_m, z_m - header.mounting_offset_m)

    def latest_on(self, floor: str) -> RobotPosition | None:
        return self._by_floor.get(floor)

    def items(self) -> list[tuple[str, RobotPosition]]:
        return list(self._by_floor.items())


def too_tall(robots: Iterable[RobotStatus], obstacle_max_m: float) -> str:
    """Which robot is taller than the highest obstacles that the maps look for, as a sentence for people; empty: none is.

    All robots share one map of obstacles, so the tallest decides how high it looks.
    """
    tall = [robot for robot in robots if robot.description.height_m > obstacle_max_m]
    if not tall:
        return ""
    tallest = max(tall, key=lambda robot: robot.description.height_m)
    return (
        f"robot {tallest.robot} is {tallest.description.height_m:.2f} m high, and obstacles above {obstacle_max_m:g} m aren't "
        "mapped: set SURVEILNAV_FUSION__MAP__OBSTACLE_MAX_M to the height of the tallest robot and 0.1 m"
    )
