"""The floor that the robot wants to reach, and the stairs that it was told to take or took."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FloorGoal:
    """The floor that the robot is heading for.

    Attributes:
        why: the reason, as a text that people are shown.
        utility: the chance of finding the target there for each metre of travel, comparable with the utilities of objects
            and frontiers. 0 if the robot sets out because nothing is left here.
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
