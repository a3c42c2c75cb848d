"""Pieces that a slip of the mouse left kilometres away: no part of the building, which would grow by the way to them."""

from __future__ import annotations

import math
from dataclasses import replace

from surveilnav.simulator.plans.sweethome import Home, Piece

#: Farther from the walls than any garden's end.
FAR_M = 100.0
_MAX_NAMED = 8


def without_outliers(home: Home) -> tuple[Home, list[str]]:
    """The plan without the pieces that stand more than ``FAR_M`` from the rectangle around all its walls and rooms, and notes
    that name them. A plan of neither walls nor rooms stays as it is."""
    corners = [p for wall in home.walls for p in (wall.start_m, wall.end_m)]
    corners += [p for room in home.rooms for p in room.outline_m]
    if not corners:
        return home, []
    low, high = map(min, zip(*corners, strict=True)), map(max, zip(*corners, strict=True))
    box = tuple(zip(low, high, strict=True))
    away = {id(piece): _distance_m(piece, box) for piece in home.pieces}
    far = sorted((p for p in home.pieces if away[id(p)] > FAR_M), key=lambda p: -away[id(p)])
    if not far:
        return home, []
    named = [
        f"{piece.name[:40]!r} at ({piece.x_m:.0f}, {piece.y_m:.0f}) m, {away[id(piece)]:,.0f} m from the walls"
        for piece in far[:_MAX_NAMED]
    ]
    more = f"; and {len(far) - len(named)} more" if len(far) > len(named) else ""
    kept = tuple(piece for piece in home.pieces if away[id(piece)] <= FAR_M)
    return replace(home, pieces=kept), [f"too far away, left out: {'; '.join(named)}{more}"]


def _distance_m(piece: Piece, box: tuple[tuple[float, float], ...]) -> float:
    """From a piece's middle to a rectangle ((lowest x, highest x), (lowest y, highest y)); 0 inside."""
    at_m = piece.x_m, piece.y_m
    return math.hypot(*(max(low - at, 0.0, at - high) for at, (low, high) in zip(at_m, box, strict=True)))
