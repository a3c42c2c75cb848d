"""Where robots say that they stand, known before the maps hold anything of it."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.messages import FrameHeader

_MAX_FLOORS = 64  # a robot may claim any number of floor names


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """Where a robot says it is [m, world]; z of the floor below it."""

    x_m: float
    y_m: float
    z_m: float


class RobotPlaces:
    """The latest place of a robot, by floor. Reading is safe from any thread."""

    def __init__(self) -> None:
        self._by_floor: dict[str, RobotPlace] = {}

    def record(self, header: FrameHeader) -> None:
        """Records where a robot's observation was made; cameras' frames and too many floors are ignored."""
        has_room = header.floor in self._by_floor or len(self._by_floor) < _MAX_FLOORS
        if header.source.startswith("robot/") and has_room:
            x_m, y_m, z_m = header.T_world_camera.translation_m
            self._by_floor[header.floor] = RobotPlace(x_m, y_m, z_m - header.mounting_offset_m)

    def on(self, floor: str) -> RobotPlace | None:
        """The latest place on a floor."""
        return self._by_floor.get(floor)

    def items(self) -> list[tuple[str, RobotPlace]]:
        """All of them, with their floors."""
        return list(self._by_floor.items())
