"""The joint point cloud against a dictionary, in any order, full, and taken up again."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.services.fusion.core import MapConfig
from surveilnav.services.fusion.core.maps.cloud import VoxelCloud

CONFIG = MapConfig(max_voxels=1_000_000)


def batch(rng, n=400, side_m=0.4):
    """What a view brings: points, colours, the camera's place, source, stamp."""
    points = rng.uniform(-side_m, side_m, (n, 3)).astype(np.float32)
    colours = rng.integers(0, 256, (n, 3)).astype(np.uint8)
    source = f"{rng.choice(['robot', 'camera'])}/{rng.integers(4)}"
    return points, colours, rng.uniform(-6, 6, 3), source, int(rng.integers(-5, 5))


def lines(cloud):
    """Everything that a cloud says, sorted: its order is no promise."""
    array = cloud.array()
    number, first_ns, last_ns, sets = cloud.provenance()
    rows = zip(array.tolist(), number.tolist(), first_ns.tolist(), last_ns.tolist(), strict=True)
    return sorted((*row, sets[k], first, last) for row, k, first, last in rows)


def test_cloud_equals_a_dictionary():
    rng = np.random.default_rng(3)
    cloud, expected = VoxelCloud(CONFIG), defaultdict(list)
    views = [batch(rng, 4000, 0.7) for _ in range(12)]
    for points, colours, p_camera, source, stamp_ns in views:
        cloud.add(points, colours, p_camera, source, stamp_ns)
        for p, colour in zip(points.astype(float), colours.tolist(), strict=True):
            squared = float(((p - p_camera) ** 2).sum())
            sigma_m = math.hypot(0.01, 0.002 * squared)
            weight = max(1, math.floor(64 * (0.01 / sigma_m) ** 2 + 0.5))
            expected[tuple(np.floor(p / 0.025).astype(int).tolist())].append(
                (weight, *(p / 0.025 % 1.0), *colour, source, stamp_ns)
            )
    array = cloud.array()
    number, first_ns, last_ns, sets = cloud.provenance()
    assert cloud.size == len(array) == len(number) == len(expected) > 20_000
    for i in range(0, len(array), 37):
        key = tuple(np.floor(array[i, :3].astype(float) / 0.025).astype(int).tolist())
        points = expected[key]
        weights = np.array([p[0] for p in points])
        mean = np.average(np.array([p[1:7] for p in points], float), axis=0, weights=weights)
        np.testing.assert_allclose(array[i, :3], (np.array(key) + mean[:3]) * 0.025, atol=0.025 / 256)
        np.testing.assert_allclose(array[i, 3:], mean[3:] / 255, atol=1e-5)
        assert sets[number[i]] == sorted({p[7] for p in points})
        assert (first_ns[i], last_ns[i]) == (min(p[8] for p in points), max(p[8] for p in points))


def test_the_mean_believes_near_views_more():
    """Both look at a wall at x = 0.012 m; the far one's noise is the larger."""
    rng = np.random.default_rng(0)
    cloud = VoxelCloud(CONFIG)
    grey = np.full((200, 3), 128, np.uint8)
    for range_m, offset_m in ((1.0, 0.012), (8.0, 0.022)):
        points = np.zeros((200, 3), np.float32)
        points[:, 0] = offset_m + rng.uniform(-0.002, 0.002, 200)
        cloud.add(points, grey, np.array([range_m, 0.0, 0.0]), "robot/r", 0)
    assert cloud.array()[0, 0] == pytest.approx(0.012, abs=0.001)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_order_gives_the_same_bits(seed):
    rng = np.random.default_rng(seed)
    views = [batch(rng) for _ in range(6)]
    one, other = VoxelCloud(CONFIG), VoxelCloud(CONFIG)
    for view in views:
        one.add(*view)
    for i in rng.permutation(len(views)):
        other.add(*views[i])
    assert lines(one) == lines(other)


def test_taken_up_again_it_goes_on_as_if_nothing_had_been():
    rng = np.random.default_rng(1)
    views = [batch(rng, 3000, 1.5) for _ in range(8)]
    whole, cloud = VoxelCloud(CONFIG), VoxelCloud(CONFIG)
    for k, view in enumerate(views):
        whole.add(*view)
        cloud.add(*view)
        if k == 4:
            cloud = VoxelCloud.from_state(cloud.state(), CONFIG)
    np.testing.assert_array_equal(whole.array(), cloud.array())
    for mine, theirs in zip(whole.provenance()[:3], cloud.provenance()[:3], strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert whole.source_sets() == cloud.source_sets()


def test_agreement_counts_what_others_saw_and_what_they_look_through():
    """Against a loop over the voxels."""
    rng, cloud = np.random.default_rng(3), VoxelCloud(CONFIG)
    for _ in range(6):
        cloud.add(*batch(rng))
    columns = cloud.state()
    columns["voxels"]["seen_through_before_ns"][::3] = 9
    cloud = VoxelCloud.from_state(columns, CONFIG)
    expected: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    sets = cloud.source_sets()
    voxels = columns["voxels"]
    for number, before_ns in zip(voxels["sources"], voxels["seen_through_before_ns"], strict=True):
        members = sets[number]
        for source in members:
            if len(members) == 1:
                expected[source][0] += before_ns == 9
            else:
                expected[source][1] += before_ns != 9
    found = {source: [a.n_refuted, a.n_confirmed] for source, a in cloud.agreement().items()}
    assert found == dict(expected)
    assert any(a.n_refuted and a.n_confirmed for a in cloud.agreement().values())


def test_a_full_cloud_refuses_and_counts():
    cloud = VoxelCloud(MapConfig(max_voxels=100))
    rng = np.random.default_rng(0)
    p = rng.uniform(0, 5, (1000, 3)).astype(np.float32)
    grey, here = np.zeros((1000, 3), np.uint8), np.zeros(3)
    cloud.add(p, grey, here, "robot/r", 0)
    assert cloud.size == 100
    assert cloud.refused >= 890
    before = cloud.refused
    cloud.add(p, grey, here, "robot/r", 1)  # what it knows it goes on counting
    assert cloud.refused == 2 * before
    assert (cloud.provenance()[2] == 1).all()
    cloud.add(np.array([[1e9, 0, 0], [np.nan, 0, 0]], np.float32), grey[:2], here, "robot/r", 2)
    assert cloud.size == 100
    assert cloud.refused == 2 * before + 2


def test_blocks_are_bounded_too():
    cloud = VoxelCloud(MapConfig(max_voxels=8000))
    p = np.random.default_rng(0).uniform(0, 50, (8000, 3)).astype(np.float32)  # dust: one voxel a block
    cloud.add(p, np.zeros((8000, 3), np.uint8), np.zeros(3), "robot/r", 0)
    assert cloud.size + cloud.refused == 8000
    assert cloud.size < 4000
