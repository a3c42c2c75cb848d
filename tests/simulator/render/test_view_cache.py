"""Cached views: the same bytes whether cached or not, no renderer when cached, damage, size, company."""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.picture import Rendered
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.render.view_cache import ViewCache
from surveilnav.simulator.world.scene import Floor, Instance, Material, Scene

CAMERA = Pinhole.from_hfov(96, 72, math.radians(79))
POSE = camera_pose((0.5, 0.5, 1.2), 0.7, -0.3)


def a_scene() -> Scene:
    v = np.array([[x, y, z] for x in (0, 5) for y in (0, 4) for z in (0, 2.6)], dtype=np.float32)
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    f = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    return Scene(
        "box",
        v,
        f,
        np.zeros((12, 3, 2), np.float32),
        np.zeros(12, np.int32),
        np.repeat(np.arange(1, 7, dtype=np.uint16), 2),
        (Material("paint", (0.8, 0.7, 0.6)),),
        tuple(Instance(i, "w", "wall", "0", (0, 0, 0), (5, 4, 2.6)) for i in range(1, 7)),
        (),
        (Floor("0", "ground", 0.0, 2.6),),
        content_hash="box",
    )


SCENE = a_scene()


def never() -> Renderer:
    raise AssertionError("a cached view must not need a renderer")


def get(cache: ViewCache, factory=lambda: Renderer(SCENE, lighting="flat"), pose=POSE, **options) -> Rendered:
    return cache.get_or_render(factory, "box", pose, CAMERA, lighting="flat", **options)


def same(a: Rendered, b: Rendered) -> bool:
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in ("rgb", "depth_m", "instance_ids"))


def test_a_view_comes_back_as_it_was_made(tmp_path):
    made = get(ViewCache(tmp_path))
    cache = ViewCache(tmp_path)
    assert same(made, get(cache, never))
    assert (cache.hits, cache.misses) == (1, 0)
    direct = Renderer(SCENE, lighting="flat").render(POSE, CAMERA)
    assert np.abs(made.depth_m - direct.depth_m).max() <= 0.00026
    np.testing.assert_array_equal(made.instance_ids, direct.instance_ids)
    assert np.abs(made.rgb.astype(int) - direct.rgb).mean() < 1.5
    assert made.depth_m.dtype == np.float32
    assert made.instance_ids.dtype == np.uint16


def test_noise_and_range_are_applied_on_reading(tmp_path):
    cache = ViewCache(tmp_path)
    get(cache)
    options = {"noise": DepthNoise.robot(), "depth_range_m": (0.5, 3.0)}
    noisy, again, other = (get(cache, never, seed=seed, **options) for seed in (1, 1, 2))
    assert same(noisy, again)
    assert not same(noisy, other)
    kept = noisy.depth_m[noisy.depth_m > 0]
    assert kept.min() >= 0.5
    assert kept.max() <= 3.0


def test_another_pose_lens_or_light_is_another_view(tmp_path):
    cache = ViewCache(tmp_path)
    keys = {
        cache.key_of("box", POSE, CAMERA, "flat"),
        cache.key_of("box2", POSE, CAMERA, "flat"),
        cache.key_of("box", camera_pose((0.5, 0.5, 1.2), 0.7001, -0.3), CAMERA, "flat"),
        cache.key_of("box", POSE, dataclasses.replace(CAMERA, cx_px=CAMERA.cx_px + 0.5), "flat"),
        cache.key_of("box", POSE, CAMERA, "baked"),
    }
    assert len(keys) == 5


def test_a_renderer_of_another_scene_is_refused(tmp_path):
    other = dataclasses.replace(SCENE, content_hash="another")
    with pytest.raises(ValueError, match="another"):
        get(ViewCache(tmp_path), lambda: Renderer(other, lighting="flat"))
    with pytest.raises(ValueError, match="baked light"):
        ViewCache(tmp_path).get_or_render(lambda: Renderer(SCENE, lighting="flat"), "box", POSE, CAMERA)


@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "other"])
def test_damaged_entries_are_made_again(tmp_path, damage):
    made = get(ViewCache(tmp_path))
    (entry,) = (tmp_path / "views").glob("*/*.view")
    data = bytearray(entry.read_bytes())
    if damage == "flip":
        data[-10] ^= 4
    elif damage == "cut":
        del data[-100:]
    elif damage == "empty":
        data.clear()
    else:
        data = bytearray(b"something else entirely")
    entry.write_bytes(bytes(data))
    cache = ViewCache(tmp_path)
    assert same(made, get(cache))
    assert cache.misses == 1
    assert same(made, get(cache, never))


def test_a_folder_can_be_shared(tmp_path):
    """Several caches at once on one folder: nobody sees half an entry."""
    poses = [camera_pose((0.5, 0.5, 1.2), yaw, -0.3) for yaw in (0.1, 0.2, 0.3)]
    expected = [get(ViewCache(tmp_path / "alone"), pose=pose) for pose in poses]

    def work(_: int) -> bool:
        cache = ViewCache(tmp_path / "shared", max_bytes=20_000)
        return all(same(get(cache, pose=pose), want) for pose, want in zip(poses * 3, expected * 3, strict=True))

    with ThreadPoolExecutor(6) as pool:
        assert all(pool.map(work, range(6)))
    assert not list((tmp_path / "shared").rglob("*.part"))


def test_a_disk_that_cannot_be_written_is_no_reason_to_stop(tmp_path, monkeypatch):
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("surveilnav.storage.write_parts", full)
    assert get(ViewCache(tmp_path)).depth_m.any()
