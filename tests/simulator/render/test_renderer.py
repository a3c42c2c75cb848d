"""The renderer against analytic scenes and against rays."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole, camera_pose, transform_points
from surveilnav.simulator.render.raster import Rasteriser
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.world.raycast import NOTHING, RayCaster
from surveilnav.simulator.world.scene import Floor, Instance, Material, Room, Scene

CAMERA = Pinhole.from_hfov(96, 72, math.radians(79))
BOXES = (  # corner, corner, label, material
    ((0.0, 0.0, 0.0), (5.0, 4.0, 2.6), "wall", 0),
    ((2.0, 1.0, 0.0), (3.0, 2.0, 0.5), "bed", 1),
    ((3.5, 2.5, 0.0), (4.0, 3.0, 1.2), "couch", 2),
)


def _box(low, high):
    v = np.array([[(high if c >> i & 1 else low)[i] for i in range(3)] for c in range(8)], dtype=np.float32)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return v, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)


def room_scene(**changes) -> Scene:
    """A room of 5 x 4 x 2.6 m with a striped box ("bed") and a red one ("couch")."""
    vertices, triangles, materials, instances, pieces = [], [], [], [], []
    for number, (low, high, label, material) in enumerate(BOXES, start=1):
        v, f = _box(low, high)
        triangles.append(f + 8 * (number - 1))
        vertices.append(v)
        materials += [material] * 12
        instances += [number] * 12
        pieces.append(Instance(number, label, label, "0", low, high))
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[::8] = 255
    faces = np.concatenate(triangles)
    scene = Scene(
        "room",
        np.concatenate(vertices),
        faces,
        np.tile(np.float32([[0, 0], [1, 0], [1, 1]]), (len(faces), 1, 1)),
        np.array(materials, np.int32),
        np.array(instances, np.uint16),
        (Material("paint", (0.9, 0.88, 0.85)), Material("stripes", (1, 1, 1), stripes), Material("r", (0.7, 0.2, 0.1))),
        tuple(pieces),
        (Room("room", "0", ((0, 0), (5, 0), (5, 4), (0, 4))),),
        (Floor("0", "ground", 0.0, 2.6),),
        content_hash="room-for-tests",
    )
    return dataclasses.replace(scene, **changes)


def triangles_scene(corners: np.ndarray) -> Scene:
    count = len(corners)
    return room_scene(
        vertices=corners.reshape(-1, 3),
        triangles=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        uvs=np.zeros((count, 3, 2), np.float32),
        material_of_triangle=np.zeros(count, np.int32),
        instance_of_triangle=np.ones(count, np.uint16),
        rooms=(),
    )


def test_depth_of_planes_is_exact():
    """From inside an empty box, the depth of each pixel is that of the first of six planes along its ray."""
    scene = triangles_scene(room_scene().vertices[room_scene().triangles[:12]])
    T = camera_pose((1.0, 1.2, 1.1), 0.4, -0.3)
    rays = CAMERA.rays().astype(np.float64) @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        to_high = (np.array([5.0, 4.0, 2.6]) - T[:3, 3]) / rays
        to_low = -T[:3, 3] / rays
    expected = np.maximum(to_high, to_low).min(axis=-1)
    depth = Renderer(scene, lighting="flat").render(T, CAMERA, depth_range_m=(0.0, 100.0)).depth_m
    np.testing.assert_allclose(depth, expected, rtol=1e-5)


@given(
    x=st.floats(0.1, 1.9),
    y=st.floats(0.1, 3.9),
    z=st.floats(0.1, 2.5),
    yaw=st.floats(-3.2, 3.2),
    pitch=st.floats(-1.57, 1.57),
)
@settings(max_examples=25, deadline=None)
def test_points_lie_on_the_surface_their_instance_names(x, y, z, yaw, pitch):
    T = camera_pose((x, y, z), yaw, pitch)
    rendered = Renderer(room_scene(), lighting="flat").render(T, CAMERA)
    assert (rendered.depth_m > 0).all()  # a closed room has no cracks
    p_world = transform_points(T, CAMERA.back_project(rendered.depth_m).astype(np.float64))
    for number, (low, high, _, _) in enumerate(BOXES, start=1):
        p = p_world[rendered.instance_ids == number]
        assert (p > np.array(low) - 1e-4).all()
        assert (p < np.array(high) + 1e-4).all()
        to_faces = np.minimum(np.abs(p - low), np.abs(p - high)).min(axis=1)
        assert (to_faces < 1e-4).all()


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_rasteriser_sees_what_rays_hit(seed):
    """Random triangles, many of them across or behind the camera's plane: the z-buffer and Embree agree."""
    rng = np.random.default_rng(seed)
    # Mostly crumbs, some large ones that hide them: enough groups for those behind to be skipped.
    size = rng.choice([0.04, 0.5, 4.0], p=[0.96, 0.035, 0.005], size=(6000, 1, 1))
    corners = (rng.uniform(-3, 3, (6000, 1, 3)) + size * rng.normal(size=(6000, 3, 3))).astype(np.float32)
    T = camera_pose(rng.uniform(-1, 1, 3), rng.uniform(-3, 3), rng.uniform(-1.5, 1.5))
    R, origin = T[:3, :3].astype(np.float32), T[:3, 3].astype(np.float32)
    drawn = Rasteriser(corners)
    seen = drawn.cast(R, origin, CAMERA)
    with pytest.MonkeyPatch.context() as patch:  # alone, only what isn't hidden is brought into the camera's frame
        patch.setattr("surveilnav.simulator.render.bands._threads", 1)
        alone = drawn.cast(R, origin, CAMERA)
    for name in ("t", "triangle", "uv"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(seen, name))
    hit = RayCaster(triangles_scene(corners)).cast(origin, CAMERA.rays() @ R.T)
    # On outlines the two round differently; nowhere else.
    differ = seen.triangle != hit.triangle
    assert differ.mean() < 0.01
    same = ~differ & (hit.triangle != NOTHING)
    assert same.any()
    np.testing.assert_allclose(seen.t[same], hit.t[same], rtol=2e-3, atol=1e-4)
    assert np.median(np.abs(seen.t[same] - hit.t[same])) < 1e-6
    assert np.quantile(np.abs(seen.uv[same] - hit.uv[same]), 0.99) < 1e-3


def test_surfaces_without_thickness_hide_what_is_behind_them():
    """Hundreds of layers behind each other: groups that are skipped as hidden were hidden."""
    layers = []
    for z in np.linspace(1.0, 9.0, 400, dtype=np.float32):
        a, b, c, d = (-9, -9, z), (9, -9, z), (9, 9, z), (-9, 9, z)
        layers += [(a, b, c), (a, c, d)]
    drawn = Rasteriser(np.array(layers[::-1], dtype=np.float32))
    seen = drawn.cast(np.eye(3, dtype=np.float32), np.zeros(3, np.float32), CAMERA)
    np.testing.assert_allclose(seen.t, 1.0, rtol=1e-6)


def test_what_stands_closely_in_front_is_not_skipped():
    """A mesh of many groups, 5 % nearer than a large plane that is drawn before it."""
    x, y = np.meshgrid(np.linspace(-3, 3, 81), np.linspace(-3, 3, 81))
    grid = np.stack([x, y, np.full_like(x, 1.9)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    mesh = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)
    left, right, far_right, far_left = (-9, -9, 2), (9, -9, 2), (9, 9, 2), (-9, 9, 2)
    beside = ((30, 0, 1), (32, 0, 1), (30, 2, 1))  # out of sight; brings the plane's group to the front of the queue
    plane = np.array([(left, right, far_right), (left, far_right, far_left), beside])
    drawn = Rasteriser(np.concatenate([plane, mesh]).astype(np.float32))
    seen = drawn.cast(np.eye(3, dtype=np.float32), np.zeros(3, np.float32), CAMERA)
    np.testing.assert_allclose(seen.t, 1.9, rtol=1e-6)


def test_range_cuts_depth_but_not_instances():
    T = camera_pose((0.5, 0.5, 1.2), 0.7, -0.3)
    renderer = Renderer(room_scene(), lighting="flat")
    far, near = renderer.render(T, CAMERA), renderer.render(T, CAMERA, depth_range_m=(1.0, 2.0))
    inside = (far.depth_m >= 1.0) & (far.depth_m <= 2.0)
    assert 0 < inside.mean() < 1
    np.testing.assert_array_equal(near.depth_m, np.where(inside, far.depth_m, 0.0))
    np.testing.assert_array_equal(near.instance_ids, far.instance_ids)


def test_texture_lies_where_its_coordinates_say():
    """A square with a picture of four colours, seen from the front: row 0 is at v = 1."""
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, :32], picture[:32, 32:], picture[32:, :32] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    a, b, c, d = (2, 1, -1), (2, -1, -1), (2, -1, 1), (2, 1, 1)
    scene = dataclasses.replace(
        triangles_scene(np.array([(a, b, c), (a, c, d)], dtype=np.float32)),
        uvs=np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], dtype=np.float32),
        materials=(Material("picture", (1, 1, 1), picture),),
    )
    camera = Pinhole.from_hfov(64, 64, math.radians(50))
    rgb = Renderer(scene, lighting="flat").render(camera_pose((0, 0, 0), 0, 0), camera).rgb
    assert [int(rgb[y, x].argmax()) for y, x in ((16, 16), (16, 48), (48, 16))] == [0, 1, 2]
    assert rgb[48, 48].max() < 10
    assert rgb[16, 16, 1] < 10


def test_far_textures_are_averaged_not_sampled():
    checker = (np.indices((256, 256)).sum(axis=0) % 2 * 255).astype(np.uint8)
    a, b, c, d = (8, 1, -1), (8, -1, -1), (8, -1, 1), (8, 1, 1)
    scene = dataclasses.replace(
        triangles_scene(np.array([(a, b, c), (a, c, d)], dtype=np.float32)),
        uvs=np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], dtype=np.float32),
        materials=(Material("checker", (1, 1, 1), np.repeat(checker[..., None], 3, axis=2)),),
    )
    rendered = Renderer(scene, lighting="flat").render(camera_pose((0, 0, 0), 0, 0), CAMERA)
    assert np.ptp(rendered.rgb[rendered.instance_ids == 1].astype(int)) <= 3


@pytest.mark.parametrize("lighting", ["flat", "baked", "shadowed"])
def test_same_view_same_bytes(lighting):
    T = camera_pose((0.5, 0.5, 1.2), 0.7, -0.3)
    a, b = (Renderer(room_scene(), lighting=lighting).render(T, CAMERA) for _ in range(2))
    for name in ("rgb", "depth_m", "instance_ids"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_threads_do_not_change_a_picture(monkeypatch):
    T = camera_pose((0.5, 0.5, 1.2), 0.7, -0.3)
    renderer = Renderer(room_scene(), lighting="flat")
    pictures = []
    for cores in (1, 2, 5):
        monkeypatch.setattr("surveilnav.simulator.render.bands._threads", cores)
        rendered = renderer.render(T, CAMERA)
        pictures.append((rendered.rgb.tobytes(), rendered.depth_m.tobytes(), rendered.instance_ids.tobytes()))
    assert pictures[0] == pictures[1] == pictures[2]


def test_lighting_changes_colours_only():
    T = camera_pose((0.5, 0.5, 1.2), 0.7, -0.3)
    modes = ("flat", "baked", "shadowed")
    flat, baked, shadowed = (Renderer(room_scene(), lighting=mode).render(T, CAMERA) for mode in modes)
    for other in (baked, shadowed):
        assert flat.depth_m.tobytes() == other.depth_m.tobytes()
        assert flat.instance_ids.tobytes() == other.instance_ids.tobytes()
        assert flat.rgb.tobytes() != other.rgb.tobytes()


def test_outdoors_is_a_bright_sky_above_and_dull_ground_below():
    scene = triangles_scene(np.zeros((0, 3, 3), np.float32))
    for lighting in ("flat", "baked", "shadowed"):
        rendered = Renderer(scene, lighting=lighting).render(camera_pose((0, 0, 0), 0.0, 0.0), CAMERA)
        assert not rendered.depth_m.any()
        assert not rendered.instance_ids.any()
        assert rendered.rgb[5].mean() > 180
        assert rendered.rgb[5].mean() > rendered.rgb[-5].mean() + 20


def test_sloppy_data_is_tolerated():
    """NaN vertices, NaN and huge texture coordinates, degenerate triangles, an empty texture."""
    scene = room_scene()
    vertices, uvs, triangles = scene.vertices.copy(), scene.uvs.copy(), scene.triangles.copy()
    vertices[8] = np.nan
    uvs[20], uvs[21] = np.nan, 1e9
    triangles[30] = 17
    bad = dataclasses.replace(
        scene,
        vertices=vertices,
        uvs=uvs,
        triangles=triangles,
        materials=(*scene.materials[:2], Material("none", (2.0, float("nan"), -1.0), np.zeros((0, 4, 3), np.uint8))),
    )
    for lighting in ("flat", "baked", "shadowed"):
        rendered = Renderer(bad, lighting=lighting).render(camera_pose((0.5, 0.5, 1.2), 0.7, -0.3), CAMERA)
        assert np.isfinite(rendered.depth_m).all()
        assert {1, 3} <= set(np.unique(rendered.instance_ids))


def test_glass_is_looked_through():
    scene = room_scene()
    clear = dataclasses.replace(scene, materials=(*scene.materials[:2], Material("glass", (1, 1, 1), alpha=0.2)))
    rendered = Renderer(clear, lighting="flat").render(camera_pose((0.5, 0.5, 1.2), 0.7, -0.3), CAMERA)
    assert 3 not in rendered.instance_ids
    assert (rendered.depth_m > 0).all()


def test_a_pose_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"finite \(4, 4\)"):
        Renderer(room_scene(), lighting="flat").render(np.full((4, 4), np.nan), CAMERA)
    with pytest.raises(ValueError, match="'baked', 'shadowed' or 'flat'"):
        Renderer(room_scene(), lighting="bright")  # type: ignore[arg-type]
