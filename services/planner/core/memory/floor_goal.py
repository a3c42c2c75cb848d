"""The floor that the robot wants to reach, and the stairs that it was told to take or took."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FloorGoal:
    """The floor that the robot is heading for, the reason for people, and the expected utility of going there.

    ``utility``: chance of finding the target per metre, as for objects and frontiers.
    """

    to_floor: str
    why: str
    utility: float = 0.0


@dataclass(frozen=True, slots=True)
class StairsCommand:
    """The robot was told to take the stairs whose end on its floor is (x, y) [m]; that counts as ``n_steps`` steps."""

    x_m: float
    y_m: float
    n_steps: int


@dataclass(frozen=True, slots=True)
class FloorChange:
    """Stairs that the robot took: at which mission step, from which floor to which, and why."""

    step: int
    floor: str
    to_floor: str
    why: str
