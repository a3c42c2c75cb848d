"""Baked light: physics that a picture must show, its store on disk, its determinism."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from surveilnav.simulator.render import bake as bake_module
from surveilnav.simulator.render.bake import bake, load_or_bake
from surveilnav.simulator.render.light_map import starts_of, steps_of
from surveilnav.simulator.render.lights import lights_of
from surveilnav.simulator.render.surfaces import surfaces_of
from surveilnav.simulator.render.tones import LIGHT_OF_BYTE
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Floor, Instance, Material, Room, Scene


def _box(low, high):
    v = np.array([[(high if c >> i & 1 else low)[i] for i in range(3)] for c in range(8)], dtype=np.float32)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return v, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)


def scene_of(*boxes, windows=(), name="baked") -> Scene:
    """Boxes (low, high, sRGB colour) in a building whose one room is the first of them."""
    parts = [_box(low, high) for low, high, _ in boxes]
    faces = np.concatenate([f + 8 * i for i, (_, f) in enumerate(parts)])
    low, high, _ = boxes[0]
    return Scene(
        name,
        np.concatenate([v for v, _ in parts]),
        faces,
        np.zeros((len(faces), 3, 2), np.float32),
        np.repeat(np.arange(len(boxes), dtype=np.int32), 12),
        np.repeat(np.arange(1, len(boxes) + 1, dtype=np.uint16), 12),
        tuple(Material(f"m{i}", color) for i, (_, _, color) in enumerate(boxes)),
        tuple(Instance(100 + i, "window", "window", "0", *w) for i, w in enumerate(windows)),
        (Room("room", "0", ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))),),
        (Floor("0", "ground", low[2], high[2] - low[2]),),
        content_hash=name,
    )


ROOM = ((0.0, 0.0, 0.0), (4.0, 4.0, 2.6), (0.85, 0.85, 0.85))
TABLE = ((2.6, 1.6, 0.7), (3.4, 2.4, 0.75), (0.5, 0.4, 0.3))


def light_by_position(scene: Scene):
    """Position and light (front, back) of every node."""
    caster = RayCaster(scene)
    surfaces = surfaces_of(scene, caster.triangle_index)
    baked = bake(scene, caster, surfaces)
    points = []
    for corners, n in zip(surfaces.corners, baked.steps, strict=True):
        weights = [(1 - (i + j) / n, i / n, j / n) for i in range(n + 1) for j in range(n + 1 - i)]
        points.append(np.array(weights) @ corners)
    return np.concatenate(points), LIGHT_OF_BYTE[baked.light], surfaces, baked


def mean_near(points, light, place, radius=0.25):
    """Mean light of the upper side of the floor near (x, y)."""
    near = (np.abs(points[:, 2]) < 1e-6) & (np.hypot(points[:, 0] - place[0], points[:, 1] - place[1]) < radius)
    assert near.any()
    return light[near].max(axis=1).mean(axis=0)  # the lit side; the other one looks out


def test_a_table_throws_a_shadow_and_the_lamp_lights_what_is_below_it():
    points, light, _, _ = light_by_position(scene_of(ROOM, TABLE))
    bare_points, bare, _, _ = light_by_position(scene_of(ROOM, name="bare"))
    below_table = (3.2, 2.0)
    shadow = mean_near(points, light, below_table)[1] / mean_near(bare_points, bare, below_table)[1]
    open_floor = mean_near(points, light, (0.8, 2.0))[1] / mean_near(bare_points, bare, (0.8, 2.0))[1]
    assert shadow < 0.6
    assert open_floor > 0.85
    assert mean_near(bare_points, bare, (2.0, 2.0))[1] > 1.3 * mean_near(bare_points, bare, (0.3, 0.3))[1]


def test_a_red_wall_tints_the_floor_beside_it():
    red = ((0.0, 0.0, 0.0), (0.05, 4.0, 2.6), (0.9, 0.05, 0.05))
    points, light, _, _ = light_by_position(scene_of(ROOM, red))
    beside, away = mean_near(points, light, (0.25, 2.0)), mean_near(points, light, (3.4, 2.0))
    assert beside[0] / beside[2] > 1.05 * away[0] / away[2]


def test_a_window_lets_daylight_in():
    window = ((-0.1, 1.2, 0.9), (0.1, 2.8, 2.1))
    hole = [  # a wall at x = 0 with an opening, and the room's other sides
        ((-0.1, 0.0, 0.0), (0.0, 4.0, 0.9), (0.8, 0.8, 0.8)),
        ((-0.1, 0.0, 2.1), (0.0, 4.0, 2.6), (0.8, 0.8, 0.8)),
        ((-0.1, 0.0, 0.9), (0.0, 1.2, 2.1), (0.8, 0.8, 0.8)),
        ((-0.1, 2.8, 0.9), (0.0, 4.0, 2.1), (0.8, 0.8, 0.8)),
        ((0.0, 0.0, -0.1), (4.0, 4.0, 0.0), (0.8, 0.8, 0.8)),
        ((0.0, 0.0, 2.6), (4.0, 4.0, 2.7), (0.8, 0.8, 0.8)),
    ]
    dark = scene_of(*hole)
    lit = dataclasses.replace(dark, instances=scene_of(ROOM, windows=[window]).instances)
    gain = []
    for scene in (dark, lit):
        points, light, _, _ = light_by_position(scene)
        gain.append(mean_near(points, light, (1.0, 2.0))[2])
    assert gain[1] > 1.2 * gain[0]


def test_a_rug_is_not_black():
    """It lies millimetres above the floor: the two must not share a sample."""
    rug = ((1.0, 1.0, 0.0), (3.0, 3.0, 0.012), (0.6, 0.2, 0.2))
    points, light, _, _ = light_by_position(scene_of(ROOM, rug))
    inner = (np.abs(points[:, :2] - 2.0) < 0.95).all(axis=1)
    on_top = inner & (np.abs(points[:, 2] - 0.012) < 1e-6)
    assert light[on_top].max(axis=1)[:, 1].min() > 0.25


def test_same_scene_same_light():
    a, b = (light_by_position(scene_of(ROOM, TABLE))[3] for _ in range(2))
    assert a.light.tobytes() == b.light.tobytes()


def test_light_is_fine_on_large_surfaces_and_coarse_on_small_ones():
    surfaces = surfaces_of(scene_of(ROOM, ((1, 1, 0), (1.03, 1.03, 0.03), (1, 1, 1))), np.arange(24))
    steps = steps_of(surfaces)
    assert steps[:12].min() >= 40
    assert steps[12:].max() == 1
    np.testing.assert_array_equal(np.diff(starts_of(steps)), [(n + 1) * (n + 2) // 2 for n in steps[:-1].astype(int)])


def test_the_store_saves_baking_and_survives_damage(tmp_path, monkeypatch):
    scene = scene_of(ROOM, TABLE)
    caster = RayCaster(scene)
    surfaces = surfaces_of(scene, caster.triangle_index)
    calls = []
    monkeypatch.setattr(bake_module, "bake", lambda *a: calls.append(1) or bake(*a))
    heard = []
    first = load_or_bake(scene, caster, surfaces, tmp_path, lambda fraction, what: heard.append((fraction, what)))
    again = load_or_bake(scene, caster, surfaces, tmp_path)
    assert len(calls) == 1
    assert first.light.tobytes() == again.light.tobytes()
    assert heard[-1][0] == 1.0
    assert [f for f, _ in heard] == sorted(f for f, _ in heard)

    (stored,) = (tmp_path / "light").glob("*.light")
    data = bytearray(stored.read_bytes())
    data[len(data) // 2] ^= 1
    stored.write_bytes(bytes(data))
    mended = load_or_bake(scene, caster, surfaces, tmp_path)
    assert len(calls) == 2
    assert mended.light.tobytes() == first.light.tobytes()

    load_or_bake(dataclasses.replace(scene, content_hash=""), caster, surfaces, tmp_path)
    assert len(list((tmp_path / "light").glob("*.light"))) == 1


def test_lamps_hang_in_rooms_and_not_in_the_open():
    scene = scene_of(ROOM)
    (lamp,) = lights_of(scene, RayCaster(scene)).position
    assert lamp[:2] == pytest.approx((2.0, 2.0), abs=0.2)
    assert 2.0 < lamp[2] < 2.5
    left = [i for i in range(12) if i not in (2, 3)]  # without the ceiling
    no_ceiling = dataclasses.replace(
        scene,
        triangles=scene.triangles[left],
        uvs=scene.uvs[left],
        material_of_triangle=scene.material_of_triangle[left],
        instance_of_triangle=scene.instance_of_triangle[left],
    )
    assert not len(lights_of(no_ceiling, RayCaster(no_ceiling)).position)
    big = scene_of(((0.0, 0.0, 0.0), (12.0, 8.0, 2.6), (1, 1, 1)))
    lamps = lights_of(big, RayCaster(big)).position
    assert 4 <= len(lamps) <= 12
    apart = np.linalg.norm(lamps[:, None] - lamps[None], axis=-1) + 99 * np.eye(len(lamps))
    assert apart.min() > 1.5


def test_a_building_without_rooms_or_triangles_is_baked_too():
    scene = dataclasses.replace(scene_of(ROOM), rooms=())
    assert len(lights_of(scene, RayCaster(scene)).position)
    empty = dataclasses.replace(
        scene,
        triangles=np.zeros((0, 3), np.int32),
        uvs=np.zeros((0, 3, 2), np.float32),
        material_of_triangle=np.zeros(0, np.int32),
        instance_of_triangle=np.zeros(0, np.uint16),
    )
    caster = RayCaster(empty)
    assert bake(empty, caster, surfaces_of(empty, caster.triangle_index)).light.shape == (1, 2, 3)
