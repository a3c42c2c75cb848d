"""Pictures of a building: RGB with textures and light, metric depth and instance ids, without a GPU.

A z-buffer finds the surfaces (``raster``), compiled loops shade them (``shading``), light comes from a bake (``bake``).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.simulator.render import shading
from surveilnav.simulator.render.bake import light_at, load_or_bake
from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.light_map import LightMap
from surveilnav.simulator.render.lights import lights_of
from surveilnav.simulator.render.picture import Lighting, Rendered, within
from surveilnav.simulator.render.raster import Rasteriser
from surveilnav.simulator.render.surfaces import surfaces_of
from surveilnav.simulator.render.tones import LIGHT_OF_BYTE, LINEAR_OF_QUARTER, TONE
from surveilnav.simulator.world.raycast import NOTHING, Hits, RayCaster
from surveilnav.simulator.world.scene import Scene

Matrix3 = NDArray[np.float32]
Vector3 = NDArray[np.float32]
Progress = Callable[[float, str], None]

_NO_LIGHT = LightMap(np.zeros(1, np.int64), np.ones(1, np.int16), np.zeros((1, 2, 3), np.uint8))
_MIDDLE = 0.33
_HIGHLIGHT = 0.75
_METER = 8  # every 8th pixel of every 8th row is metered
_MODES = {"flat": 0, "baked": 1, "shadowed": 2}
_NO_PIXEL_LIGHT = np.zeros((1, 1, 3), np.float32)


class Renderer:
    """Renders one scene; safe to share between threads.

    ``lighting``: "baked" (shadows and bounced light made once per scene and kept in ``cache_dir``), "flat" (neither
    bake nor shadows), "shadowed" (shadows computed anew for each view: slow, for comparison).
    ``progress(fraction, what)`` hears about the bake.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        lighting: Lighting = "baked",
        cache_dir: Path | None = None,
        progress: Progress | None = None,
    ) -> None:
        if lighting not in ("baked", "shadowed", "flat"):
            raise ValueError(f"lighting is 'baked', 'shadowed' or 'flat', got {lighting!r}")
        self.scene = scene
        self.lighting = lighting
        self.caster = RayCaster(scene)
        self._surfaces = surfaces_of(scene, self.caster.triangle_index)
        self._light = _NO_LIGHT
        if lighting == "baked":
            self._light = load_or_bake(scene, self.caster, self._surfaces, cache_dir, progress)
        self._rasteriser = Rasteriser(self._surfaces.corners)
        self._lights = lights_of(scene, self.caster) if lighting == "shadowed" else None

    def render(
        self,
        T_world_camera: Matrix4,
        camera: Pinhole,
        *,
        depth_range_m: tuple[float, float] = (0.0, 20.0),
        noise: DepthNoise | None = None,
        seed: int = 0,
        colors: bool = True,
    ) -> Rendered:
        """The picture from ``T_world_camera`` (4, 4). Noise is drawn from ``seed`` before the range is cut.

        Without ``colors``, ``rgb`` is black and depth and instances come in a fraction of the time.
        """
        R, origin = _frame(T_world_camera)
        hits = self._rasteriser.cast(R, origin, camera)
        rgb = self._shade(R, origin, camera, hits) if colors else np.zeros((*hits.t.shape, 3), dtype=np.uint8)
        if noise is None:
            depth_m, instance_ids = self._measure(hits, depth_range_m)
        else:
            depth_m, instance_ids = self._measure(hits, (0.0, np.inf))
            depth_m = within(noise.apply(depth_m, camera, seed), depth_range_m)
        return Rendered(rgb, depth_m, instance_ids)

    def _shade(self, R: Matrix3, origin: Vector3, camera: Pinhole, hits: Hits) -> NDArray[np.uint8]:
        pixel_light = _NO_PIXEL_LIGHT if self._lights is None else self._light_of_pixels(R, origin, camera, hits)
        seen = (
            R,
            *_lens(camera),
            hits.t,
            hits.triangle,
            hits.uv,
            self._surfaces,
            _MODES[self.lighting],
            self._light,
            pixel_light,
            LINEAR_OF_QUARTER,
            LIGHT_OF_BYTE,
        )
        rgb = np.empty((camera.height_px, camera.width_px, 3), dtype=np.uint8)
        metered = np.empty((-(-camera.height_px // _METER), -(-camera.width_px // _METER)), dtype=np.float32)
        in_bands(shading.shade, len(metered), _METER, *seen, 0.0, TONE, rgb, metered)
        in_bands(shading.shade, camera.height_px, 1, *seen, exposure_of(metered), TONE, rgb, hits.t)
        return rgb

    def _light_of_pixels(self, R: Matrix3, origin: Vector3, camera: Pinhole, hits: Hits) -> NDArray[np.float32]:
        """Light (H, W, 3) from shadow and occlusion rays of this very view: what a bake saves."""
        assert self._lights is not None
        light = np.zeros((*hits.t.shape, 3), dtype=np.float32)
        hit = hits.triangle != NOTHING
        directions = (camera.rays()[hit] @ R.T).astype(np.float32)
        normals = self._surfaces.normals[hits.triangle[hit]]
        normals = np.where((normals * directions).sum(axis=1, keepdims=True) > 0, -normals, normals)
        points = origin + directions * hits.t[hit][:, None] + 0.004 * normals
        light[hit] = light_at(points, normals, self._lights, self.caster)
        return light

    def _measure(
        self, hits: Hits, depth_range_m: tuple[float, float]
    ) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
        depth_m = np.empty(hits.t.shape, dtype=np.float32)
        instance_ids = np.empty(hits.t.shape, dtype=np.uint16)
        near, far = depth_range_m
        in_bands(
            shading.depth_and_instances,
            hits.t.shape[0],
            hits.t,
            hits.triangle,
            self._surfaces.instances,
            float(near),
            float(far),
            depth_m,
            instance_ids,
        )
        return depth_m, instance_ids


def exposure_of(metered: NDArray[np.float32]) -> float:
    """A camera's automatic exposure: the mean of metered luminance becomes a middle tone, but lights keep shape."""
    by_mean = _MIDDLE / max(float(metered.mean(dtype=np.float64)), 1e-6)
    by_lights = _HIGHLIGHT / max(float(np.quantile(metered, 0.95)), 1e-6)
    return float(np.clip(min(by_mean, by_lights), 0.5, 2.5))


def _frame(T_world_camera: Matrix4) -> tuple[Matrix3, Vector3]:
    T = np.asarray(T_world_camera, dtype=np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise ValueError(f"a camera pose is a finite (4, 4) matrix, got shape {T.shape}: {T.tolist()}")
    return np.ascontiguousarray(T[:3, :3], dtype=np.float32), np.ascontiguousarray(T[:3, 3], dtype=np.float32)


def _lens(camera: Pinhole) -> tuple[float, float, float, float]:
    return float(camera.fx_px), float(camera.fy_px), float(camera.cx_px), float(camera.cy_px)
