"""Masks from depth on made-up rooms: a box on a floor before a wall."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.perception.segmenters.depth_in_box import find_floor, find_mask

CAMERA = Pinhole.from_hfov(320, 240, math.radians(79))


def room(pitch_rad: float, noise: float = 0.0, height_m: float = 0.9) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(depth [m], object pixels, floor pixels): a block 0.8 x 0.8 x 0.7 m, its front 1.8 m away, a wall at 4 m."""
    T = camera_pose((0, 0, height_m), 0.0, pitch_rad)
    directions = CAMERA.rays().astype(np.float64) @ T[:3, :3].T
    origin = T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        t_floor = np.where(directions[..., 2] < 0, -origin[2] / directions[..., 2], np.inf)
        t_wall = np.where(directions[..., 0] > 0, 4.0 / directions[..., 0], np.inf)
        low = (np.array([1.8, -0.4, 0.0]) - origin) / directions
        high = (np.array([2.6, 0.4, 0.7]) - origin) / directions
    enter, leave = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
    t_block = np.where((enter < leave) & (enter > 0), enter, np.inf)
    depth = np.minimum(np.minimum(t_floor, t_wall), t_block)
    block = t_block <= depth
    floor = (t_floor <= depth) & ~block
    rng = np.random.default_rng(0)
    depth = depth + noise * (0.0012 + 0.0019 * (depth - 0.4) ** 2) * rng.normal(size=depth.shape)
    depth[rng.random(depth.shape) < 0.01 * noise] = 0
    return depth.astype(np.float32), block, floor


def box_around(pixels: np.ndarray, margin: int = 4) -> tuple[float, float, float, float]:
    rows, cols = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    height, width = pixels.shape
    return (
        float(max(0, cols[0] - margin)),
        float(max(0, rows[0] - margin)),
        float(min(width, cols[-1] + 1 + margin)),
        float(min(height, rows[-1] + 1 + margin)),
    )


@pytest.mark.parametrize("pitch_deg", [0, -15, -30])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_block_is_cut_out_of_floor_and_wall(pitch_deg: float, noise: float) -> None:
    depth, block, _ = room(math.radians(pitch_deg), noise)
    box = box_around(block, margin=12)
    x0, y0, x1, y1 = (int(v) for v in box)
    mask = find_mask(depth, box, find_floor(depth, CAMERA))
    assert mask is not None
    assert mask.shape == (y1 - y0, x1 - x0)
    truth = block[y0:y1, x0:x1]
    assert (mask & truth).sum() > 0.98 * mask.sum(), "nothing but the block"
    assert (mask & truth).sum() > 0.8 * truth.sum(), "all of it but its rim"


def test_the_wall_seen_through_a_table_is_not_the_table() -> None:
    depth = np.full((240, 320), 4.0, np.float32)
    table = np.zeros((240, 320), bool)
    table[80:105, 60:240] = table[80:200, 60:75] = table[80:200, 225:240] = True
    depth[table] = 2.0
    mask = find_mask(depth, (58.0, 78.0, 242.0, 202.0))
    assert mask is not None
    truth = table[78:202, 58:242]
    assert (mask & truth).sum() > 0.98 * mask.sum()
    assert (mask & truth).sum() > 0.8 * truth.sum()


@pytest.mark.parametrize("pitch_deg", [5, 0, -15, -30, -60])
def test_the_floor_is_found_without_a_pose(pitch_deg: float) -> None:
    depth, block, floor = room(math.radians(pitch_deg), noise=1.0)
    found = find_floor(depth, CAMERA)
    assert found is not None
    seen = depth > 0
    assert (found & floor).sum() > 0.8 * (floor & seen).sum()
    assert (found & block).sum() <= 0.15 * block.sum()


def test_no_floor_in_a_wall() -> None:
    assert find_floor(np.full((240, 320), 2.0, np.float32), CAMERA) is None
    assert find_floor(np.zeros((240, 320), np.float32), CAMERA) is None


def test_without_depth_the_whole_box_counts() -> None:
    assert find_mask(np.zeros((240, 320), np.float32), (10, 10, 100, 100)) is None


def test_holes_in_depth_never_count() -> None:
    depth, _, _ = room(-0.3)
    depth[100:140, 140:180] = 0
    mask = find_mask(depth, (0.0, 0.0, 320.0, 240.0), find_floor(depth, CAMERA))
    assert mask is not None
    assert not (mask & (depth == 0)).any()


@pytest.mark.parametrize(
    "box", [(-20.0, -20.0, 50.5, 60.2), (300.0, 200.0, 400.0, 300.0), (5.0, 5.0, 6.0, 6.0), (0.0, 0.0, 320.0, 240.0)]
)
def test_boxes_over_the_edge(box: tuple[float, float, float, float]) -> None:
    depth, _, _ = room(0.0)
    mask = find_mask(depth, box)
    if mask is not None:
        assert mask.shape == (
            min(240, math.ceil(box[3])) - max(0, int(box[1])),
            min(320, math.ceil(box[2])) - max(0, int(box[0])),
        )
