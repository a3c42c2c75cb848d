"""Obstacle and exploration maps, and the cloud."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from services.fusion.core import FusionConfig, JointMap, MapConfig
from services.fusion.core.cloud import VoxelCloud


def views_of(world, n=12):
    return [world.view(1.5 + 0.2 * i, 2.0, i * math.tau / n, seq=i) for i in range(n)]


def layers(joint, floor="0"):
    """All layers that counts make, cut to the world cells [-1, 8) x [-1, 6) m."""
    out = {}
    for name in ("occupancy", "explored", "frontier"):
        grid, array = joint.layer(floor, name)
        row, col = (round((-1 - o) / grid.resolution_m) for o in (grid.origin_y_m, grid.origin_x_m))
        out[name] = array[row : row + 140, col : col + 180]
    cloud = joint.layer(floor, "cloud")[1]
    out["cloud"] = cloud[np.lexsort(cloud.T)]
    return out


def at(joint, name, x, y):
    grid, array = joint.layer("0", name)
    row, col = grid.cells_of((x, y))
    return int(array[row, col])


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_views_does_not_matter(world, seed):
    world.boxes["table"] = ((4.0, 1.0, 0.0), (4.6, 1.6, 0.7))
    views = views_of(world) + [world.view(5.8, 3.8, 3.9, -0.5, height=1.8, source="camera/c", view=i) for i in range(2)]
    shuffled = [views[i] for i in np.random.default_rng(seed).permutation(len(views))]
    one, other = JointMap(), JointMap()
    for a, b in zip(views, shuffled, strict=True):
        one.integrate(a, None)
        other.integrate(b, None)
    first, second = layers(one), layers(other)
    for name in first:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_walls_block_floor_is_free_and_beyond_is_unknown(world):
    joint = JointMap()
    for view in views_of(world):
        joint.integrate(view, None)
    assert at(joint, "occupancy", 3.0, 4.02) == 1
    assert at(joint, "occupancy", 3.0, 3.5) == 0
    assert at(joint, "explored", 3.0, 3.5) == 1
    assert at(joint, "explored", 3.0, 5.0) == 0
    assert joint.layer("0", "frontier")[1].sum() == 0  # a closed room has none


def test_low_things_block_and_what_hangs_high_does_not(world):
    world.boxes |= {"stool": ((3.5, 2.8, 0.0), (3.8, 3.1, 0.4)), "lamp": ((4.5, 2.8, 1.4), (4.8, 3.1, 1.8))}
    joint = JointMap()
    for view in views_of(world):
        joint.integrate(view, None)
    assert at(joint, "occupancy", 3.65, 2.82) == 1
    assert at(joint, "occupancy", 4.65, 2.82) == 0
    assert (joint.layer("0", "cloud")[1][:, 3] == 80 / 255).sum() > 10  # the lamp was seen


def test_a_single_noisy_point_does_not_block(world):
    view = world.view(1.0, 2.0, 0.0)
    depth_m = view.depth_m.copy()
    depth_m[59:62, 79:82] = 2.0  # 3x3 pixels of air 2 m ahead; one of them is sampled at stride 3
    joint = JointMap(FusionConfig(map=MapConfig(points_per_view=160 * 120 // 9)))
    joint.integrate(replace(view, depth_m=depth_m), None)
    assert at(joint, "occupancy", 3.0, 2.0) == 0
    joint.integrate(replace(view, depth_m=np.full_like(depth_m, 2.0)), None)
    assert at(joint, "occupancy", 3.0, 2.0) == 1


def test_bare_floor_seen_often_clears_a_ghost(world):
    world.boxes["ghost"] = ((3.0, 1.8, 0.0), (3.3, 2.2, 0.5))
    joint = JointMap()
    joint.integrate(world.view(1.0, 2.0, 0.0), None)
    assert at(joint, "occupancy", 3.02, 2.0) == 1
    world.boxes.clear()
    for i in range(7):
        joint.integrate(world.view(1.3, 2.0, 0.0, -0.4, seq=i), None)
    assert at(joint, "occupancy", 3.02, 2.0) == 0


def test_where_a_robot_stood_is_free_and_explored(world):
    world.boxes["thing"] = ((3.0, 1.9, 0.0), (3.1, 2.1, 0.5))
    joint = JointMap()
    for i in range(3):
        joint.integrate(world.view(1.0, 2.0, 0.0, seq=i), None)
    assert at(joint, "occupancy", 3.02, 2.0) == 1
    world.boxes.clear()
    joint.integrate(world.view(3.02, 2.0, 0.0, 1.2), None)  # it drove there
    assert at(joint, "occupancy", 3.02, 2.0) == 0
    assert at(joint, "explored", 3.02, 2.17) == 1
    hanging = world.view(1.0, 1.0, 0.0, 1.2, height=1.8, source="camera/c")
    joint.integrate(hanging, None)  # says nothing of the floor below it
    assert at(joint, "explored", 1.0, 1.0) == 0


def test_growing_keeps_what_is_there(world):
    world.room = ((-20.0, -20.0, 0.0), (20.0, 20.0, 2.5))
    views = [world.view(s * x, s * x / 2, 0.7 * x, -0.3, seq=x) for x in range(8) for s in (1.0, -1.0)]  # out both ways
    small, large = (JointMap(FusionConfig(map=MapConfig(extent_m=extent_m))) for extent_m in (1.0, 24.0))
    for view in views:
        small.integrate(view, None)
        large.integrate(view, None)
    (grid, a), (_, b) = small.layer("0", "explored"), large.layer("0", "explored")
    assert 10 < grid.rows * grid.resolution_m < 24
    assert a.sum() == b.sum() > 0
    cells = np.argwhere(a)
    there = large.layer("0", "explored")[0].cells_of(grid.centres_of(cells))
    assert b[there[:, 0], there[:, 1]].all()


def test_a_view_from_the_moon_is_refused_and_changes_nothing(world):
    joint = JointMap()
    joint.integrate(world.view(1.0, 2.0, 0.0), None)
    before = layers(joint)
    far = world.view(1.0, 2.0, 0.0)
    far.T_world_camera[0, 3] = 1e5
    with pytest.raises(ValueError, match="max_extent_m"):
        joint.integrate(far, None)
    after = layers(joint)
    assert joint.revision == 1
    for name in before:
        np.testing.assert_array_equal(before[name], after[name])


def test_cloud_equals_a_dictionary():
    rng = np.random.default_rng(3)
    cloud, expected = VoxelCloud(0.025, 1_000_000), {}
    for _ in range(5):
        p = rng.uniform(-2, 2, (20_000, 3)).astype(np.float32)
        c = rng.integers(0, 256, (20_000, 3)).astype(np.uint8)
        cloud.add(p, c)
        for key, colour in zip(np.floor(p.astype(float) / 0.025).astype(int).tolist(), c.tolist(), strict=True):
            expected.setdefault(tuple(key), []).append(colour)
    array = cloud.array()
    assert cloud.size == len(array) == len(expected) > 65_536 / 2  # it has grown meanwhile
    for x, y, z, *colour in array[::97]:
        key = tuple(np.floor(np.array([x, y, z]) / 0.025).astype(int).tolist())
        np.testing.assert_allclose(colour, np.mean(expected[key], axis=0) / 255, atol=1e-5)


def test_a_full_cloud_refuses_and_counts():
    cloud = VoxelCloud(0.025, 100)
    p = np.random.default_rng(0).uniform(0, 5, (1000, 3)).astype(np.float32)
    cloud.add(p, np.zeros((1000, 3), np.uint8))
    assert cloud.size == 100
    assert cloud.refused >= 890
    cloud.add(np.array([[1e9, 0, 0]], np.float32), np.zeros((1, 3), np.uint8))
    assert cloud.size == 100
