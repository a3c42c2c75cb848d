"""Obstacle and exploration maps."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.services.fusion.core import FusionConfig, JointMap, MapConfig
from surveilnav.services.fusion.core.maps.floor_map import FloorMap
from surveilnav.services.fusion.core.maps.projection import world_points


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


@pytest.fixture
def shaft(tools):
    """A floor with a shaft across it, 3 < x < 4.5 m, hollow below."""
    world = tools.world(room=((0.0, 0.0, -1.5), (8.0, 4.0, 2.5)))
    world.boxes |= {"floor": ((0.0, 0.0, -0.2), (3.0, 4.0, 0.0)), "beyond": ((4.5, 0.0, -0.2), (8.0, 4.0, 0.0))}
    return world


def test_a_drop_blocks_from_its_edge_on(shaft):
    joint = JointMap()
    joint.integrate(shaft.view(2.0, 2.0, 0.0, -0.9), None)
    assert [at(joint, "occupancy", x, 2.0) for x in (2.92, 2.97, 3.2, 3.3)] == [0, 0, 1, 1]
    assert at(joint, "explored", 3.2, 2.0) == 1


def test_what_lies_under_a_floor_is_not_seen_of_it(shaft):
    view = shaft.view(2.0, 2.0, 0.0, -0.9)
    points, _ = world_points(view, 3000, 5.0, 0.05)
    assert (points[:, 0] > 5.0).any()  # it looks through the shaft below the floor beyond
    joint = JointMap()
    joint.integrate(view, None)
    for name in ("occupancy", "explored"):
        grid, layer = joint.layer("0", name)
        assert layer[:, grid.cells_of((4.6, 0.0))[1] :].sum() == 0, name


def test_a_shaft_stays_one_after_somebody_crossed_it(shaft):
    joint = JointMap(FusionConfig(map=MapConfig(carve_margin_m=0.01)))
    shaft.boxes["lift"] = ((3.1, 1.5, -0.2), (3.6, 2.5, 0.2))
    joint.integrate(shaft.view(2.0, 2.0, 0.0, -0.9, seq=0), None)
    assert at(joint, "occupancy", 3.2, 2.0) == 1
    del shaft.boxes["lift"]
    for seq in range(1, 4):
        joint.integrate(shaft.view(2.0, 2.0, 0.0, -0.9, seq=seq), None)
    x, y, z = joint.layer("0", "cloud")[1][:, :3].T
    assert not ((z > 0.15) & (abs(x - 3.2) < 0.06) & (abs(y - 2.0) < 0.2)).any()  # the lift is gone
    assert at(joint, "occupancy", 3.2, 2.0) == 1


def test_a_floor_laid_over_a_shaft_is_free_when_it_was_seen_often(shaft):
    joint = JointMap()
    joint.integrate(shaft.view(2.0, 2.0, 0.0, -0.9), None)
    assert at(joint, "occupancy", 3.2, 2.0) == 1
    shaft.boxes["hatch"] = ((3.0, 0.0, -0.2), (4.5, 4.0, 0.0))
    for seq in range(1, 8):
        joint.integrate(shaft.view(2.0, 2.0, 0.0, -0.6, seq=seq), None)
    assert at(joint, "occupancy", 3.2, 2.0) == 0


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


# --- literal references ------------------------------------------------------------------------------------------------


def slow_maps(views, config, z_m=0.0):
    """The paper's projection of points onto the plane and exploration by ray, point by point, in dictionaries; the views
    are a camera's."""
    r = config.resolution_m
    points_in, blocked_by, bare_by, explored = Counter(), Counter(), Counter(), set()
    falls_in, fallen_by = Counter(), Counter()
    for view in views:
        points, _ = world_points(view, config.points_per_view, config.max_range_robot_m, config.depth_edge)
        cx, cy, cz = view.T_world_camera[:3, 3].tolist()
        blocks, falls, bare, rays = Counter(), Counter(), set(), {}
        for x, y, z in points.astype(float).tolist():
            height, squared = z - z_m, (x - cx) ** 2 + (y - cy) ** 2
            ceiling, far = z_m + config.explored_max_m, math.sqrt(squared)
            deep = height < -config.drop_min_m - config.obstacle_noise_per_m * squared
            if height < -config.drop_min_m:  # the ray is of this floor until it is so deep
                share = (cz - z_m + config.drop_min_m) / (cz - z)
            if deep:
                x, y, squared = cx + share * (x - cx), cy + share * (y - cy), share**2 * squared
            cell = math.floor(y / r), math.floor(x / r)
            falls[cell] += deep
            if height <= config.explored_max_m and math.sqrt(squared) <= config.explored_range_camera_m:
                explored.add(cell)
            if config.obstacle_min_m + config.obstacle_noise_per_m * squared <= height <= config.obstacle_max_m:
                blocks[cell] += 1
            elif abs(height) <= 0.08:
                bare.add(cell)
            # the part of the ray that runs below the ceiling of what explores
            start = far * (cz - ceiling) / (cz - z) if cz > ceiling > z else 0.0
            end = far if cz > ceiling or z <= ceiling else far * (ceiling - cz) / (z - cz)
            end = far * share if height < -config.drop_min_m else end
            if end > 0 and not (cz > ceiling and z >= ceiling):
                k = math.floor((math.atan2(y - cy, x - cx) / math.tau + 1) * 360) % 360
                before = rays.get(k, (math.inf, 0.0))
                rays[k] = min(before[0], start), max(before[1], end)
        for k in range(360):  # a gap of one degree
            a, b = rays.get((k - 1) % 360), rays.get((k + 1) % 360)
            if k not in rays and a and b and min(a[1], b[1]) > max(a[0], b[0]):
                rays[k + 1000] = max(a[0], b[0]), min(a[1], b[1])
        reaches = {k % 1000: v for k, v in rays.items()}
        n = math.ceil(config.max_range_robot_m / r) + 1
        row0, col0 = math.floor(cy / r), math.floor(cx / r)
        for row in range(row0 - n, row0 + n + 1):
            for col in range(col0 - n, col0 + n + 1):
                dx, dy = (col + 0.5) * r - cx, (row + 0.5) * r - cy
                start, end = reaches.get(math.floor((math.atan2(dy, dx) / math.tau + 1) * 360) % 360, (1.0, 0.0))
                if start <= math.hypot(dx, dy) <= min(end, config.explored_range_camera_m):
                    explored.add((row, col))
        falls = +falls
        points_in += blocks
        falls_in += falls
        blocked_by += Counter(set(blocks))
        fallen_by += Counter(set(falls))
        bare_by += Counter(bare - set(blocks) - set(falls))
    occupied = {
        cell
        for points, views_of_it in ((points_in, blocked_by), (falls_in, fallen_by))
        for cell, n in points.items()
        if n >= config.obstacle_min_points and bare_by[cell] <= config.clear_ratio * views_of_it[cell]
    }
    return occupied, explored


@settings(max_examples=8, deadline=None)
@given(x=st.floats(1, 5), y=st.floats(1, 3), yaw=st.floats(-3, 3), pitch=st.floats(-0.7, 0.3), height=st.floats(0.4, 2))
def test_obstacles_and_explored_cells_are_those_of_a_literal_reference(tools, x, y, yaw, pitch, height):
    world = tools.world(room=((0.0, 0.0, -1.0), (6.0, 4.0, 2.5)))  # the floor ends at y = 2.4 m
    world.boxes |= {"floor": ((0.0, 0.0, -0.2), (6.0, 2.4, 0.0)), "table": ((4.0, 1.0, 0.0), (4.6, 1.6, 0.7))}
    config = MapConfig(points_per_view=3000, robot_radius_m=0.0, carve_views=0, explored_range_camera_m=2.5)
    views = [
        world.view(x, y, yaw + turn, pitch, seq=seq, height=height, source="camera/c", range_m=(0.1, 4.0))
        for seq, turn in enumerate((0.0, 0.5, 2.0))
    ]
    joint = JointMap(FusionConfig(map=config.model_copy(update={"max_range_camera_m": 5.0})))
    for view in views:
        joint.integrate(view, None)
    occupied, explored = slow_maps(views, config)
    for name, expected in (("occupancy", occupied), ("explored", explored)):
        grid, layer = joint.layer("0", name)
        row0, col0 = round(grid.origin_y_m / 0.05), round(grid.origin_x_m / 0.05)
        found = {(row0 + row, col0 + col) for row, col in np.argwhere(layer).tolist()}
        assert len(found ^ expected) <= 2, name  # rounding at a cell's or a ray's very edge
        assert len(expected) > 100 or name == "occupancy"


@pytest.mark.parametrize("stop", [1, 7])
def test_taken_up_again_it_goes_on_as_if_nothing_had_been(world, stop):
    world.boxes["table"] = ((4.0, 1.0, 0.0), (4.6, 1.6, 0.7))
    config = MapConfig(extent_m=2.0)  # it grows on the way
    whole, floor = (FloorMap("0", 0.0, (1.5, 2.0), config) for _ in range(2))
    for k, view in enumerate(views_of(world), 1):
        whole.integrate(view)
        floor.integrate(view)
        whole.revision = floor.revision = k
        if k == stop:
            floor = FloorMap.from_state(floor.state(), config)
    assert (floor.grid, floor.z_m, floor.revision) == (whole.grid, whole.z_m, whole.revision)
    for layer in ("occupied", "explored", "frontier"):
        np.testing.assert_array_equal(getattr(floor, layer)(), getattr(whole, layer)())
    np.testing.assert_array_equal(floor.cloud.array(), whole.cloud.array())


def voxels(cloud):
    return np.floor(cloud[:, :3].astype(float) / 0.025).astype(int).tolist()


def test_provenance_goes_line_by_line_with_the_cloud(world):
    views = [world.view(1.0, 2.0, 0.0, seq=3), world.view(5.8, 3.8, 3.9, -0.5, height=1.8, source="camera/c", seq=8)]
    joint, alone = JointMap(), {}
    for view in views:
        joint.integrate(view, None)
        one = JointMap()
        one.integrate(view, None)
        alone[view.source] = set(map(tuple, voxels(one.layer("0", "cloud")[1])))
    cloud, provenance = (joint.layer("0", name)[1] for name in ("cloud", "provenance"))
    assert provenance.shape == (len(cloud), 3)
    assert provenance.dtype == np.int64
    sets = joint.source_sets("0")
    seen_by = [sets[k] for k in provenance[:, 0]]
    for voxel, by in zip(voxels(cloud), seen_by, strict=True):
        assert by == sorted(source for source, seen in alone.items() if tuple(voxel) in seen)
    both = np.array([len(s) == 2 for s in seen_by])
    assert both.sum() > 10
    np.testing.assert_array_equal(provenance[both, 1:], np.tile([3, 8], (both.sum(), 1)))
