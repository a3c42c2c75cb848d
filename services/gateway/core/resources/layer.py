"""A map layer: where it lies in the world."""

from __future__ import annotations

from urllib.parse import quote

from pydantic import BaseModel, Field

from surveilnav.services.gateway.core.layers import Drawn, transform
from surveilnav.services.gateway.core.resources.base import ROOT, Number


class Layer(BaseModel):
    floor: str
    layer: str
    target: str = Field(
        description="whose value it shows; empty for the other layers, and where the newest mission's is"
    )
    revision: int
    rows: int
    cols: int
    resolution_m: float
    T_world_cell: list[list[float]] = Field(
        description="3 x 3: maps (column, row, 1) of a cell to (x, y, 1) of its centre [m]; row 0 is the southernmost"
    )
    low: Number = Field(description="the lowest value; null for other layers")
    high: Number
    views_left_out: int = Field(description="how many views another model looked at")
    picture: str = Field(description="where it is as PNG, north up")
    array: str = Field(description="where it is as numpy's .npy")

    @classmethod
    def of(cls, floor: str, layer: str, target: str, drawn: Drawn, revision: int, root: str = ROOT) -> Layer:
        """A layer by its array."""
        address = f"{root}/floors/{floor}/layers/{layer}"
        asked = f"?target={quote(target)}" if target else ""
        return cls(
            floor=floor,
            layer=layer,
            target=target,
            revision=revision,
            rows=drawn.grid.rows,
            cols=drawn.grid.cols,
            resolution_m=drawn.grid.resolution_m,
            T_world_cell=transform(drawn.grid),
            low=drawn.low,
            high=drawn.high,
            views_left_out=drawn.views_left_out,
            picture=f"{address}.png{asked}",
            array=f"{address}.npy{asked}",
        )
