"""Masks made fine by depth: against slow code for each pixel, and where depth jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.perception.detectors.guided_mask import guided_mask


def literal(logits: np.ndarray, depth_m: np.ndarray, x: int, y: int, cells_per_pixel: float) -> float:
    """The logit of a pixel by the paper's formula: sum of f(distance) g(difference of log depth) logit, over sixteen cells."""
    h, w = logits.shape
    at_y, at_x = ((at + 0.5) * cells_per_pixel - 0.5 for at in (y, x))

    def log_depth(metres: float) -> float:
        return math.log(max(metres, 0.1)) if metres > 0 else math.log(100.0)

    total = weights = 0.0
    for i in range(math.floor(at_y) - 1, math.floor(at_y) + 3):
        for j in range(math.floor(at_x) - 1, math.floor(at_x) + 3):
            r, c = min(max(i, 0), h - 1), min(max(j, 0), w - 1)
            middle = [
                min(max(round((k + 0.5) / cells_per_pixel - 0.5), 0), n - 1)
                for k, n in zip((r, c), depth_m.shape, strict=True)
            ]
            off = (log_depth(depth_m[y, x]) - log_depth(depth_m[middle[0], middle[1]])) / 0.03
            near = math.exp(-0.5 * (((i - at_y) / 0.7) ** 2 + ((j - at_x) / 0.7) ** 2))
            weight = near * (math.exp(-0.5 * off * off) + 1e-6)
            total += weight * logits[r, c]
            weights += weight
    return total / weights


@pytest.mark.parametrize(("size", "cells_per_pixel"), [((60, 80), 0.25), ((48, 48), 0.125), ((30, 40), 0.4)])
def test_each_pixel_is_as_the_formula_has_it(size: tuple[int, int], cells_per_pixel: float) -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 3.0, size).astype(np.float32)
    depth[rng.random(size) < 0.2] = 0.0
    coarse = tuple(math.ceil(side * cells_per_pixel) for side in size)
    logits = rng.normal(0, 3, coarse).astype(np.float32)
    x0, y0, x1, y1 = window = (3, 5, size[1] - 2, size[0] - 1)
    mask = guided_mask(logits, depth, window, cells_per_pixel)
    assert mask.shape == (y1 - y0, x1 - x0)
    for y in range(y0, y1):
        for x in range(x0, x1):
            value = literal(logits, depth, x, y, cells_per_pixel)
            assert mask[y - y0, x - x0] == (value > 0) or abs(value) < 1e-3


def test_it_ends_where_depth_jumps_not_where_cells_do() -> None:
    depth = np.full((80, 80), 3.0, np.float32)
    depth[13:51, 19:47] = 2.0  # the object; cells are eight pixels wide
    logits = np.where(depth[4::8, 4::8] < 2.5, 4.0, -4.0).astype(np.float32)
    assert (guided_mask(logits, depth, (0, 0, 80, 80), 1 / 8) == (depth < 2.5)).mean() > 0.995
    assert (guided_mask(logits, depth, (15, 10, 60, 60), 1 / 8) == (depth < 2.5)[10:60, 15:60]).mean() > 0.99
    coarse = np.repeat(np.repeat(logits > 0, 8, axis=0), 8, axis=1)
    assert (coarse == (depth < 2.5)).mean() < 0.96


def test_without_depth_it_is_smooth_and_a_large_window_is_its_whole_size() -> None:
    logits = np.full((120, 160), -1.0, np.float32)
    logits[30:90, 40:120] = 1.0
    mask = guided_mask(logits, np.zeros((960, 1280), np.float32), (100, 50, 1200, 900), 1 / 8)
    assert mask.shape == (850, 1100)
    wanted = np.zeros((960, 1280), bool)
    wanted[240:720, 320:960] = True
    assert (mask == wanted[50:900, 100:1200]).mean() > 0.98
