"""Surfaces drawn by chance: plain paints, and patterns of wood, cloth and pictures."""

from __future__ import annotations

import colorsys
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.world.scene import Material

Pattern = Literal["any", "wood", "scene"]
Color = tuple[float, float, float]

_SIZE = 64
_WOODS = ((168, 124, 82), (139, 98, 63), (196, 160, 116), (95, 62, 42), (215, 190, 155), (60, 40, 30))


def colour(rng: np.random.Generator) -> Color:
    """Most things in rooms are dull: saturation is low, brightness anything."""
    return colorsys.hsv_to_rgb(rng.random(), float(rng.beta(1.2, 2.5)), float(rng.uniform(0.12, 0.95)))


def painted(rng: np.random.Generator) -> Material:
    """One colour."""
    return Material("paint", colour(rng), shininess=float(rng.uniform(0, 0.4)))


def glossy(rng: np.random.Generator) -> Material:
    """One strong colour."""
    return Material(
        "gloss", colorsys.hsv_to_rgb(rng.random(), float(rng.uniform(0.4, 0.95)), float(rng.uniform(0.4, 1.0)))
    )


def patterned(rng: np.random.Generator, pattern: Pattern = "any") -> Material:
    """A texture of 64 x 64 pixels: stripes, checks, spots, clouds; grain of wood; or what a screen or picture may show."""
    if pattern == "wood":
        light = 1.0 + 0.18 * _clouds(rng, 2, 24)
        rgb = np.asarray(_WOODS[rng.integers(len(_WOODS))])[None, None] * light[..., None]
    elif pattern == "scene":
        rgb = np.stack([127 + 110 * _clouds(rng, 4, 5) for _ in range(3)], axis=-1)
    else:
        share = _weave(rng)[..., None]
        rgb = 255 * (share * np.array(colour(rng)) + (1 - share) * np.array(colour(rng)))
    return Material(f"pattern-{pattern}", (1.0, 1.0, 1.0), np.clip(rgb, 0, 255).astype(np.uint8))


def _weave(rng: np.random.Generator) -> NDArray[np.float64]:
    """(64, 64) 0-1: how much of the first of two colours."""
    y, x = np.mgrid[0:_SIZE, 0:_SIZE] * (2 * np.pi / _SIZE)
    a, b = rng.integers(1, 9, 2)
    kind = rng.integers(4)
    if kind == 0:
        return np.asarray(np.sin(a * x) > rng.uniform(-0.7, 0.7), np.float64)
    if kind == 1:
        return np.asarray(np.sin(a * x) * np.sin(b * y) > 0, np.float64)
    if kind == 2:
        return np.asarray(np.sin(a * x) + np.sin(a * y) > rng.uniform(0.6, 1.6), np.float64)
    return np.clip(0.5 + 0.5 * _clouds(rng, int(a) + 1, int(b) + 1), 0, 1)


def _clouds(rng: np.random.Generator, rows: int, cols: int) -> NDArray[np.float64]:
    """(64, 64) smooth noise, about -1 to 1."""
    coarse = rng.standard_normal((rows, cols)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (_SIZE, _SIZE), interpolation=cv2.INTER_CUBIC), np.float64)
