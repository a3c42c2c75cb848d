"""Rays against a scene: a thin layer over Open3D's ``RaycastingScene`` (Embree, no GPU, no GL)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import ConfigError
from surveilnav.simulator.world.scene import Scene

try:
    import open3d.core as o3c
    from open3d.t.geometry import RaycastingScene
except ImportError as error:  # the wheel needs system libraries that slim machines lack
    raise ConfigError(
        f"Open3D can't be loaded ({error}). It needs system libraries; on Debian or Ubuntu run: "
        "apt-get install libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6"
    ) from error

#: Open3D's "no triangle".
NOTHING = np.uint32(0xFFFFFFFF)


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """First hits of rays, all of shape (...).

    ``t``: in units of the ray's direction, inf where nothing was hit; ``triangle``: index, ``NOTHING`` where
    nothing was hit; ``uv`` (..., 2): barycentric weights of the triangle's second and third corner.
    """

    t: NDArray[np.float32]
    triangle: NDArray[np.uint32]
    uv: NDArray[np.float32]


class RayCaster:
    """Casts rays against the opaque triangles of a scene (glass, alpha < 0.5, is left out).

    ``triangle_index`` (T,) uint32 lists them; degenerate and non-finite triangles are left out too.
    """

    def __init__(self, scene: Scene) -> None:
        alpha = np.array([m.alpha for m in scene.materials], dtype=np.float32)
        finite = np.asarray(np.isfinite(scene.vertices).all(axis=1), dtype=np.bool_)
        usable = finite[scene.triangles].all(axis=1)
        if len(alpha):
            usable &= alpha[scene.material_of_triangle] >= 0.5
        self.triangle_index = np.flatnonzero(usable).astype(np.uint32)
        self._scene, self._finite = scene, finite
        self._built: RaycastingScene | None = None

    @property
    def _rays(self) -> RaycastingScene:
        """Embree's tree, built when first needed: who renders with baked light never needs one."""
        if self._built is None:
            built = RaycastingScene(nthreads=0)
            triangles = np.ascontiguousarray(self._scene.triangles[self.triangle_index], dtype=np.uint32)
            vertices = np.where(self._finite[:, None], self._scene.vertices, 0.0).astype(np.float32)
            built.add_triangles(o3c.Tensor(vertices), o3c.Tensor(triangles))
            self._built = built
        return self._built

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hits of rays from ``origins`` (..., 3) along ``directions`` (..., 3), in the world."""
        rays = np.empty((*np.broadcast_shapes(origins.shape, directions.shape)[:-1], 6), dtype=np.float32)
        rays[..., :3] = origins
        rays[..., 3:] = directions
        hits = self.cast_rays(rays)
        hit: NDArray[np.bool_] = hits.triangle != NOTHING
        if not len(self.triangle_index):
            return hits
        return Hits(hits.t, np.where(hit, self.triangle_index[np.where(hit, hits.triangle, 0)], NOTHING), hits.uv)

    def cast_rays(self, rays: NDArray[np.float32]) -> Hits:
        """As ``cast`` for rays (..., 6) float32 of origin and direction; ``triangle`` counts in ``triangle_index``."""
        if not len(self.triangle_index) or rays.size == 0:
            shape = rays.shape[:-1]
            return Hits(np.full(shape, np.inf, np.float32), np.full(shape, NOTHING), np.zeros((*shape, 2), np.float32))
        result = self._rays.cast_rays(o3c.Tensor.from_numpy(rays))
        return Hits(result["t_hit"].numpy(), result["primitive_ids"].numpy(), result["primitive_uvs"].numpy())

    def occluded(
        self, p_from: NDArray[np.float32], p_to: NDArray[np.float32], shorten: float = 0.999
    ) -> NDArray[np.bool_]:
        """Whether something stands between points ``p_from`` and ``p_to``, both (..., 3) [m, world]."""
        rays = np.empty((*np.broadcast_shapes(p_from.shape, p_to.shape)[:-1], 6), dtype=np.float32)
        rays[..., :3] = p_from
        rays[..., 3:] = p_to - p_from
        return self.occluded_rays(rays, shorten)

    def occluded_rays(self, rays: NDArray[np.float32], tfar: float, tnear: float = 1e-3) -> NDArray[np.bool_]:
        """Whether rays (..., 6) float32 hit anything at t in [tnear, tfar]."""
        if not len(self.triangle_index) or rays.size == 0:
            return np.zeros(rays.shape[:-1], dtype=bool)
        hit: NDArray[np.bool_] = self._rays.test_occlusions(o3c.Tensor.from_numpy(rays), tnear=tnear, tfar=tfar).numpy()
        return hit
