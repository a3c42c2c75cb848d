"""Made-up floors, and the maps that a robot and cameras would make of them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from surveilnav.geometry import Grid
from surveilnav.robot_frame import Nav2Map, PlanarTransform
from surveilnav.robot_frame.nav2_map import FREE, OCCUPIED, UNKNOWN

CELL_M = 0.05
_FINE = 2  # pixels of the true floor in a cell


@dataclass
class Floor:
    """A floor with rooms.

    Attributes:
        solid: bool, walls and furniture, in pixels of 2.5 cm; ``rooms``: the rectangle of each room (row0, row1, col0, col1).
        furniture: rectangles in the same pixels.
    """

    solid: np.ndarray
    rooms: list[tuple[int, int, int, int]]
    furniture: list[tuple[int, int, int, int]]


def _px(metres: float) -> int:
    return round(metres / CELL_M * _FINE)


def made_up_floor(
    rng: np.random.Generator, width_m: float = 12.0, height_m: float = 9.0, furniture: bool = True
) -> Floor:
    """Rooms that halve each other until they are small, with doors between neighbours."""
    rows, cols = _px(height_m), _px(width_m)
    solid = np.zeros((rows, cols), bool)
    wall = _px(0.15)
    solid[:wall] = solid[-wall:] = True
    solid[:, :wall] = solid[:, -wall:] = True
    rooms, waiting = [], [(wall, rows - wall, wall, cols - wall)]
    while waiting:
        r0, r1, c0, c1 = waiting.pop()
        h, w = r1 - r0, c1 - c0
        if max(h, w) < _px(5.0) or min(h, w) < _px(2.0):
            rooms.append((r0, r1, c0, c1))
            continue
        along = w >= h
        n = w if along else h
        cut = int(n * rng.uniform(0.35, 0.65))
        door = int((h if along else w) * rng.uniform(0.1, 0.6))
        gap = slice(door, door + _px(0.9))
        strip = np.ones(h if along else w, bool)
        strip[gap] = False
        if along:
            solid[r0:r1, c0 + cut : c0 + cut + wall] |= strip[:, None]
            waiting += [(r0, r1, c0, c0 + cut), (r0, r1, c0 + cut + wall, c1)]
        else:
            solid[r0 + cut : r0 + cut + wall, c0:c1] |= strip[None, :]
            waiting += [(r0, r0 + cut, c0, c1), (r0 + cut + wall, r1, c0, c1)]
    pieces = []
    if furniture:
        for r0, r1, c0, c1 in rooms:
            for _ in range(int(rng.integers(2, 5))):
                h, w = _px(rng.uniform(0.3, 1.2)), _px(rng.uniform(0.3, 1.8))
                if h < r1 - r0 - 4 and w < c1 - c0 - 4:
                    r, c = int(rng.integers(r0, r1 - h)), int(rng.integers(c0, c1 - w))
                    pieces.append((r, r + h, c, c + w))
    return Floor(solid, rooms, pieces)


def seen(
    floor: Floor, rooms: list[int], rng: np.random.Generator, missing: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """What is seen of some rooms: bool (rows, cols) of surfaces and of free floor. ``missing``: share of the furniture unseen."""
    solid = floor.solid.copy()
    for r0, r1, c0, c1 in floor.furniture:
        if rng.random() >= missing:
            solid[r0:r1, c0:c1] = True
    within = np.zeros(solid.shape, bool)
    margin = _px(0.1)
    for k in rooms:
        r0, r1, c0, c1 = floor.rooms[k]
        within[max(0, r0 - margin) : r1 + margin, max(0, c0 - margin) : c1 + margin] = True
    free = within & ~solid
    surface = within & solid & cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    return surface, free


def _noisy(p: np.ndarray, rng: np.random.Generator, sigma_m: float, dropped: float) -> np.ndarray:
    p = p[rng.random(len(p)) >= dropped]
    return p + rng.normal(0, sigma_m, p.shape)


def _places(mask: np.ndarray) -> np.ndarray:
    return (np.argwhere(mask)[:, ::-1] + 0.5) * CELL_M / _FINE


def _map_of(surface: np.ndarray, free: np.ndarray, margin_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Kinds of cells (rows, cols) around places (n, 2), and the corner of cell (0, 0)."""
    corner = np.minimum(surface.min(axis=0), free.min(axis=0)) - margin_m
    top = np.maximum(surface.max(axis=0), free.max(axis=0)) + margin_m
    cols, rows = np.ceil((top - corner) / CELL_M).astype(int)
    kinds = np.full((rows, cols), UNKNOWN, np.uint8)
    for places, kind in ((free, FREE), (surface, OCCUPIED)):
        col, row = np.floor((places - corner) / CELL_M).astype(int).T
        kinds[row, col] = kind
    return kinds, corner


def robots_map(
    floor: Floor,
    rooms: list[int],
    T_building_map: PlanarTransform,
    rng: np.random.Generator,
    *,
    missing: float = 0.2,
    sigma_m: float = 0.02,
    dropped: float = 0.2,
) -> Nav2Map:
    """The robot's map of some rooms, in its own frame."""
    surface, free = seen(floor, rooms, rng, missing)
    T = T_building_map.inverse()
    kinds, corner = _map_of(
        T.apply(_noisy(_places(surface), rng, sigma_m, dropped)), T.apply(_places(free)), float(rng.uniform(0.2, 1.0))
    )
    return Nav2Map(kinds, CELL_M, PlanarTransform(*corner))


def joint_map(
    floor: Floor,
    rooms: list[int],
    rng: np.random.Generator,
    *,
    missing: float = 0.2,
    sigma_m: float = 0.02,
    dropped: float = 0.2,
) -> tuple[Grid, np.ndarray, np.ndarray]:
    """Frame, obstacles and explored cells of the joint map of some rooms."""
    surface, free = seen(floor, rooms, rng, missing)
    kinds, corner = _map_of(_noisy(_places(surface), rng, sigma_m, dropped), _places(free), 2.0)
    grid = Grid(float(corner[0]), float(corner[1]), CELL_M, *kinds.shape)
    return grid, (kinds == OCCUPIED).astype(np.uint8), (kinds != UNKNOWN).astype(np.uint8)
