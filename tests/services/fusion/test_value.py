"""The joint value map (eq. 2) and its variants."""

from __future__ import annotations

import math

import numpy as np
import pytest

from services.fusion.core import FusionConfig, JointMap, ValueConfig
from services.fusion.core.projection import reach, sweep, world_points


@pytest.fixture
def story(world, tools):
    """Views of a robot and two cameras with image embeddings that sound more or less like the target e0."""

    def picture(score):
        return np.array([score, math.sqrt(1 - score**2), 0, 0, 0, 0, 0, 0], np.float32)

    rng = np.random.default_rng(2)
    out = [(world.view(1 + 0.3 * i, 2, 0.5 * i, seq=i), picture(rng.uniform(0, 0.9))) for i in range(6)]
    for name, x, yaw in (("a", 0.5, 0.4), ("b", 5.5, 2.6)):
        for k in range(3):
            view = world.view(x, 0.5, yaw + 0.5 * k, -0.5, height=1.8, source=f"camera/{name}", view=k)
            out.append((view, picture(rng.uniform(0, 0.9))))
    return out


def joint_of(story, tools, fusion):
    joint = JointMap(FusionConfig(value=ValueConfig(fusion=fusion)))
    for view, image in story:
        joint.integrate(view, tools.seen(image=image))
    return joint


def footprint(view, grid):
    """(azimuth bin or -1) of every cell of the grid that the view covers; its geometry is tested elsewhere."""
    c = FusionConfig().map
    limit = c.max_range_robot_m if view.is_robot else c.max_range_camera_m
    points, _ = world_points(view, c.points_per_view, limit, c.depth_edge)
    reach_m = reach(points, view.T_world_camera[:3, 3], c.explored_max_m).astype(np.float16).astype(np.float32)
    row0, col0 = round(grid.origin_y_m / grid.resolution_m), round(grid.origin_x_m / grid.resolution_m)
    x, y, _ = view.T_world_camera[:3, 3]
    return sweep(reach_m, x, y, grid.resolution_m, row0, col0, grid.rows, grid.cols)


def test_average_is_equation_2(story, tools):
    joint = joint_of(story, tools, "average")
    grid, found = joint.layer("0", "value", tools.unit(0))
    sums, counts = np.zeros((2, *grid.shape)), np.zeros((2, *grid.shape))
    for view, image in story:
        covered = footprint(view, grid) >= 0
        sums[int(not view.is_robot)][covered] += np.float16(image[0])
        counts[int(not view.is_robot)][covered] += 1
    expected = np.full(grid.shape, np.nan)
    both = 0
    for r, c in np.argwhere(counts.sum(axis=0) > 0):
        averages = [sums[k, r, c] / counts[k, r, c] for k in (0, 1) if counts[k, r, c]]
        expected[r, c] = (averages[0] + averages[1]) / 2 if len(averages) == 2 else averages[0]
        both += len(averages) == 2
    assert both > 100
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_confidence_is_vlfms_rule(story, tools):
    joint = joint_of(story, tools, "confidence")
    grid, found = joint.layer("0", "value", tools.unit(0))
    value, weight = np.full(grid.shape, np.nan), np.zeros(grid.shape)
    for view, image in story:
        azimuths = footprint(view, grid)
        forward = view.T_world_camera[:3, 2]
        axis, half_fov = math.atan2(forward[1], forward[0]), math.radians(79) / 2
        for r, c in np.argwhere(azimuths >= 0):
            angle = abs(math.remainder(math.radians(azimuths[r, c] + 0.5) - axis, math.tau))
            w = 0.25 + 0.75 * math.cos(min(1.0, angle / half_fov) * math.pi / 2) ** 2
            v, c0, score = value[r, c], weight[r, c], float(np.float16(image[0]))
            value[r, c] = score if c0 == 0 else (c0 * v + w * score) / (c0 + w)
            weight[r, c] = (c0**2 + w**2) / (c0 + w)
    np.testing.assert_allclose(found, value, atol=1e-3)


def test_latest_is_the_last_word(story, tools):
    joint = joint_of(story, tools, "latest")
    grid, found = joint.layer("0", "value", tools.unit(0))
    view, image = story[-1]
    assert np.allclose(found[footprint(view, grid) >= 0], np.float16(image[0]))


def test_a_second_target_gets_its_map_from_what_was_seen_before(story, tools):
    early, late = JointMap(), JointMap()
    early.integrate(story[0][0], tools.seen(image=story[0][1]))
    early.layer("0", "value", tools.unit(1))  # asked for from the start ...
    for view, image in story:
        early.integrate(view, tools.seen(image=image))
        late.integrate(view, tools.seen(image=image))
    fresh, kept = (j.layer("0", "value", tools.unit(1))[1] for j in (late, early))  # ... or only now
    np.testing.assert_allclose(fresh, kept, atol=1e-6)
    assert np.isfinite(fresh).sum() > 1000
    assert not np.allclose(fresh, late.layer("0", "value", tools.unit(0))[1], equal_nan=True)


def test_a_cameras_new_picture_takes_the_place_of_its_old_one(story, tools):
    view, _ = story[-1]
    joint = JointMap()
    for i in (0, 1, 2):
        joint.integrate(view, tools.seen(image=tools.unit(i)))
        joint.layer("0", "value", tools.unit(2))
    found = joint.layer("0", "value", tools.unit(2))[1]
    np.testing.assert_allclose(found[np.isfinite(found)], 1.0)


def test_another_backends_embeddings_say_nothing(story, tools):
    joint = joint_of(story, tools, "confidence")
    assert np.isnan(joint.layer("0", "value", np.ones(5, np.float32))[1]).all()


def test_robot_views_are_forgotten_beyond_the_limit(world, tools):
    joint = JointMap(FusionConfig(value=ValueConfig(max_views=3)))
    joint.integrate(world.view(1, 1, 0, source="camera/c"), tools.seen(image=tools.unit(0)))
    for i in range(5):
        joint.integrate(world.view(3, 2, i, seq=i), tools.seen(image=tools.unit(0)))
    assert len(joint._storeys["0"].value) == 3
    grid, found = joint.layer("0", "value", tools.unit(0))
    row, col = grid.cells_of((4.0, 1.0))
    assert np.isfinite(found[row, col])  # the camera's view is kept
