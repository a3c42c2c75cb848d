"""What every method of finding a robot's frame returns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from surveilnav.robot_frame.planar import PlanarTransform

Method = Literal["point pairs", "tag", "map match"]


@dataclass(frozen=True, slots=True)
class FoundFrame:
    """Where a robot's map lies in the building, and how well that is known.

    Attributes:
        T_building_map: the altitude is that of the floor which the map shows.
        residual_m: root mean square distance between where the two frames put the same thing.
        residual_rad: the same of directions, where the method compares them; None: it doesn't.
        method: how it was found.
        n_constraints: number of pairs, stops or cells that it rests on.
        sentence: the result for people, with what limits it.
        left_out: numbers, from 1, of the pairs or stops that contradicted the others and weren't used.
    """

    T_building_map: PlanarTransform
    residual_m: float
    residual_rad: float | None
    method: Method
    n_constraints: int
    sentence: str
    left_out: tuple[int, ...] = ()


def in_words(T_building_map: PlanarTransform) -> str:
    """Such as "the map's origin lies at (1.20, -0.35) m, turned by 12.5 degrees"."""
    T = T_building_map
    return (
        f"the map's origin lies at ({T.x_m:.2f}, {T.y_m:.2f}) m in the building, turned by "
        f"{math.degrees(T.yaw_rad):.1f} degrees"
    )


def listed(numbers: tuple[int, ...] | list[int]) -> str:
    """Such as "1, 2 and 5"."""
    words = [str(n) for n in numbers]
    return " and ".join(([", ".join(words[:-1])] if len(words) > 1 else []) + words[-1:])
