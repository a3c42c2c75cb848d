"""What the entries of files that people write have in common: tables without unknown keys, finite numbers, polygons."""

from __future__ import annotations

import math
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from surveilnav.geometry.polygon import MAX_CORNERS, polygon_fault

_Coordinate = TypeVar("_Coordinate", bound=float)


class Entry(BaseModel):
    """A table of such a file; a key that it doesn't know is a mistake."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("expected a finite number")
    return value


def _simple(corners: list[tuple[float, float]]) -> list[tuple[float, float]]:
    if fault := polygon_fault(corners):
        raise ValueError(fault)
    return corners


Finite = Annotated[float, AfterValidator(_finite)]
#: The corners (x, y) of a simple polygon, such as ``Corners[Finite]``.
Corners = Annotated[
    list[tuple[_Coordinate, _Coordinate]], Field(min_length=3, max_length=MAX_CORNERS), AfterValidator(_simple)
]
