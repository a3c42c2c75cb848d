"""Floor and wall textures made from a seed: the example homes have none, and a detector needs some."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.world.scene import Material

FloorKind = Literal["wood", "tile", "carpet"]

#: One repeat of a floor texture covers this much floor [m].
TILE_M: dict[str, float] = {"wood": 1.6, "tile": 1.2, "carpet": 1.5}
_SIZE = 256

_WOODS = ((168, 124, 82), (139, 98, 63), (196, 160, 116), (112, 78, 52), (181, 146, 108))
_TILES = ((214, 210, 202), (176, 172, 166), (226, 219, 205), (150, 158, 162), (198, 186, 170))
_CARPETS = ((150, 140, 128), (112, 118, 128), (168, 152, 130), (128, 108, 100), (138, 146, 132))
_WALLS = ((236, 232, 222), (228, 224, 216), (222, 228, 228), (238, 228, 210), (224, 230, 218), (232, 222, 220))


def _smooth_noise(rng: np.random.Generator, cells_y: int, cells_x: int) -> NDArray[np.float64]:
    """(256, 256) noise, about ±1, that wraps around."""
    coarse = rng.standard_normal((cells_y, cells_x))

    def stretched(a: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
        n = a.shape[axis]
        at = np.arange(_SIZE) * n / _SIZE
        i = at.astype(int)
        t = at - i
        t = (t * t * (3 - 2 * t)).reshape((-1, 1) if axis == 0 else (1, -1))
        return np.asarray(np.take(a, i % n, axis) * (1 - t) + np.take(a, (i + 1) % n, axis) * t)

    return stretched(stretched(coarse, 0), 1)


def _picture(base: tuple[int, int, int], light: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.clip(np.asarray(base) * light[..., None], 0, 255).astype(np.uint8)


def _wood(rng: np.random.Generator) -> NDArray[np.uint8]:
    planks, boards = 8, 2
    y, x = np.mgrid[0:_SIZE, 0:_SIZE]
    row = y * planks // _SIZE
    shift = rng.integers(0, _SIZE, planks)[row]
    board = ((x + shift) % _SIZE) * boards // _SIZE
    light = 1.0 + 0.10 * rng.standard_normal((planks, boards))[row, board]
    light = light + 0.05 * _smooth_noise(rng, 96, 6) + 0.03 * _smooth_noise(rng, 128, 24)
    gap = (y % (_SIZE // planks) == 0) | (((x + shift) % (_SIZE // boards)) == 0)
    return _picture(_WOODS[rng.integers(len(_WOODS))], np.where(gap, 0.6, light))


def _tile(rng: np.random.Generator) -> NDArray[np.uint8]:
    count = 4
    y, x = np.mgrid[0:_SIZE, 0:_SIZE]
    light = 1.0 + 0.03 * rng.standard_normal((count, count))[y * count // _SIZE, x * count // _SIZE]
    light = light + 0.03 * _smooth_noise(rng, 20, 20)
    step = _SIZE // count
    return _picture(_TILES[rng.integers(len(_TILES))], np.where((y % step < 2) | (x % step < 2), 0.72, light))


def _carpet(rng: np.random.Generator) -> NDArray[np.uint8]:
    light = 1.0 + 0.05 * rng.standard_normal((_SIZE, _SIZE)) + 0.03 * _smooth_noise(rng, 12, 12)
    return _picture(_CARPETS[rng.integers(len(_CARPETS))], light)


_MAKERS = {"wood": _wood, "tile": _tile, "carpet": _carpet}


def floor_material(kind: FloorKind, rng: np.random.Generator) -> Material:
    """A floor covering; its texture repeats every ``TILE_M[kind]``."""
    return Material(f"floor-{kind}", (1.0, 1.0, 1.0), _MAKERS[kind](rng))


def floor_kind(room: str, rng: np.random.Generator) -> FloorKind:
    """What a room of that name would be covered with: tiles where it gets wet, carpet or wood elsewhere."""
    name = room.lower()
    if any(
        word in name
        for word in ("bath", "toilet", "wc", "kitchen", "laundry", "garage", "terrace", "balcony", "basement")
    ):
        return "tile"
    if "bedroom" in name and rng.random() < 0.5:
        return "carpet"
    return "wood"


def wall_material(rng: np.random.Generator, color: tuple[float, float, float] | None = None) -> Material:
    """Painted plaster: nearly plain, light; ``color`` (sRGB 0-1) instead of one by chance."""
    base = _WALLS[rng.integers(len(_WALLS))]
    rgb = color if color is not None else (base[0] / 255, base[1] / 255, base[2] / 255)
    light = 0.985 + 0.012 * rng.standard_normal((_SIZE, _SIZE)) + 0.01 * _smooth_noise(rng, 8, 8)
    return Material("wall", rgb, _picture((255, 255, 255), np.clip(light, 0, 1)))
