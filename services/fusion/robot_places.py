"""Where robots say that they stand: known before the maps hold anything of it."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.messages import FrameHeader

_MAX_FLOORS = 64  # a robot may say what it likes


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """Where a robot says it is [m, world]; z of the floor below it."""

    x_m: float
    y_m: float
    z_m: float


class RobotPlaces:
    """The place last said, by floor. May be asked from any thread."""

    def __init__(self) -> None:
        self._by_floor: dict[str, RobotPlace] = {}

    def note(self, header: FrameHeader) -> None:
        """Notes where an observation was made; a floor beyond those there is room for is left out."""
        room = header.floor in self._by_floor or len(self._by_floor) < _MAX_FLOORS
        if header.source.startswith("robot/") and room:
            x_m, y_m, z_m = header.T_world_camera.translation_m
            self._by_floor[header.floor] = RobotPlace(x_m, y_m, z_m - header.mounting_offset_m)

    def on(self, floor: str) -> RobotPlace | None:
        """The place last said on a floor."""
        return self._by_floor.get(floor)

    def items(self) -> list[tuple[str, RobotPlace]]:
        """All of them, by floor."""
        return list(self._by_floor.items())
