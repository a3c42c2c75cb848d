"""Doors, windows and stairs: what they cut out, and what of their models stays."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.plans.plan import Opening
from surveilnav.simulator.plans.sweethome import Piece
from surveilnav.simulator.plans.words import OUTER, SHUT, words_of

#: An opening reaches this far to both sides of its piece, so that a wall thicker than the model is cut through.
_REACH_M = 0.02

#: Lower openings are no way for a person or a robot.
_DOOR_HEIGHT_M = 1.8

_OPENING = re.compile(r"sweethome3d_(opening|hinge|window_pane)|window_pane", re.IGNORECASE)
_PANE = re.compile(r"window_pane", re.IGNORECASE)
#: A French window is one that people walk through.
_KINDS = (
    (re.compile(r"\b(?:\w*doors?|doorways?|french)\b", re.IGNORECASE), True),
    (re.compile(r"\b(?:windows?|fixed)\b", re.IGNORECASE), False),
    (re.compile(r"\b(?:gates?|frames?)\b", re.IGNORECASE), True),
)


def is_door(piece: Piece) -> bool:
    """Whether an opening is a door: by its catalogue id, else by its English name, else whatever one can walk through."""
    for words in (_id_words(piece), words_of(piece.name)):
        for kind, is_one in _KINDS:
            if kind.search(words):
                return is_one
    return piece.z_m < 0.05 and piece.size_m[2] >= _DOOR_HEIGHT_M


def stands_open(piece: Piece, *, indoors: bool = False) -> bool:
    """Whether a robot may pass: doors inside the building are open, those to the street are not.

    Args:
        indoors: there are rooms with a ceiling on both sides of it, so that a front door leads to no street.
    """
    words = f"{_id_words(piece)} {words_of(piece.name)}"
    return is_door(piece) and not SHUT.search(words) and (indoors or not OUTER.search(words))


def _id_words(piece: Piece) -> str:
    """The words of a catalogue id without its author: a translation leaves them as they were."""
    return words_of(piece.catalog_id.rpartition("#")[2])


def beside(piece: Piece) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (n, 2) [m] on the one side of a door and on the other, the nearest first."""
    c, s = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
    away = np.array([0.3, 0.5, 0.7]) + max(0.0, piece.size_m[1] / 2 - 0.2)
    offset = away[:, None] * np.array([-s, c])
    centre = np.array([piece.x_m, piece.y_m])
    return centre + offset, centre - offset


def is_moving_part(group: str) -> bool:
    """Whether a group of a door's or window's model is a leaf, a handle or a pane."""
    return bool(_OPENING.search(group))


def is_pane(group: str) -> bool:
    return bool(_PANE.search(group))


def opening_of(piece: Piece, z_floor_m: float) -> Opening:
    """The box that a door or window cuts out of the walls that it lies on."""
    z = z_floor_m + piece.z_m
    # A threshold is no obstacle: what stands within 5 cm of the floor is cut down to it.
    low = z_floor_m if piece.z_m < 0.05 else z
    return Opening(
        (piece.x_m, piece.y_m), piece.yaw_rad, piece.size_m[0], piece.size_m[1] + 2 * _REACH_M, low, z + piece.size_m[2]
    )


def is_stairs(piece: Piece) -> bool:
    """Whether a piece is a staircase that cuts the floor above."""
    return bool(piece.stair_cut)


def stair_cut_outline(piece: Piece) -> NDArray[np.float64]:
    """The staircase's cut in the floor above, (N, 2) [m, world]: its path in the unit square, y towards the front."""
    unit = path_points(piece.stair_cut)
    if len(unit) < 3:
        unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    x = (unit[:, 0] - 0.5) * piece.size_m[0] * (-1.0 if piece.mirrored else 1.0)
    y = -(unit[:, 1] - 0.5) * piece.size_m[1]
    c, s = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
    return np.column_stack([piece.x_m + c * x - s * y, piece.y_m + s * x + c * y])


_TOKEN = re.compile(r"[MmLlHhVvCcQqZz]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_ARGUMENTS = {"m": 2, "l": 2, "h": 1, "v": 1, "c": 6, "q": 4}


def path_points(path: str) -> NDArray[np.float64]:
    """The first closed outline of an SVG path, (N, 2); a curve becomes the straight line to its end."""
    points: list[tuple[float, float]] = []
    x = y = 0.0
    command = ""
    tokens = _TOKEN.findall(path[:10_000])
    at = 0
    while at < len(tokens) and len(points) < 500:
        if tokens[at].isalpha():
            command = tokens[at]
            at += 1
            if command in "zZ":
                break
            continue
        need = _ARGUMENTS.get(command.lower(), 0)
        if need == 0 or at + need > len(tokens) or any(t.isalpha() for t in tokens[at : at + need]):
            break
        values = [float(t) for t in tokens[at : at + need]]
        at += need
        relative = command.islower()
        if command in "hH":
            x = x + values[0] if relative else values[0]
        elif command in "vV":
            y = y + values[0] if relative else values[0]
        else:
            x, y = (x + values[-2], y + values[-1]) if relative else (values[-2], values[-1])
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 10 and abs(y) <= 10):
            return np.zeros((0, 2))
        if not points or points[-1] != (x, y):
            points.append((x, y))
    if len(points) > 1 and points[0] == points[-1]:
        points.pop()
    return np.array(points, dtype=np.float64).reshape(-1, 2)
