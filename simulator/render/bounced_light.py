"""Light that comes by way of other surfaces and the sky.

A sample's bounced light is the mean over cosine-distributed rays of (colour they hit) x (its direct light + ambient).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.render import shading
from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.hashed import hemisphere_rays
from surveilnav.simulator.render.light_map import starts_of
from surveilnav.simulator.render.light_samples import Samples
from surveilnav.simulator.render.surfaces import Surfaces
from surveilnav.simulator.world.raycast import RayCaster

_FIRST_RAYS = 8
_RAYS_AT_ONCE = 1_000_000


def bounced_light(
    samples: Samples,
    direct: NDArray[np.float32],
    steps: NDArray[np.int16],
    surfaces: Surfaces,
    caster: RayCaster,
    tell: Callable[[float], None],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Light (S, 3) that reaches each sample by way of other surfaces and the sky; (S,) whether it lies inside one."""
    gathering = _Gathering(samples, direct, steps, surfaces, caster)
    # A few rays tell what lies inside furniture and walls, where nobody will ever look; the rest is worth more.
    gathering.gather(np.arange(len(samples.points)), _FIRST_RAYS, 1.0, lambda f: tell(0.3 * f))
    buried = gathering.close > 0.9
    open_ = np.flatnonzero((gathering.reach > 0.4) | (direct[:, 1] > 0.0))
    more = int(np.clip(60_000_000 // max(len(open_), 1), 16, 32)) - _FIRST_RAYS
    gathering.gather(open_, more, more / (more + _FIRST_RAYS), lambda f: tell(0.3 + 0.7 * f))
    return gathering.bounced, buried


class _Gathering:
    """Bounced light (S, 3) so far, and by sample ``reach`` [m] and ``close``: see ``shading.gather``."""

    def __init__(
        self,
        samples: Samples,
        direct: NDArray[np.float32],
        steps: NDArray[np.int16],
        surfaces: Surfaces,
        caster: RayCaster,
    ) -> None:
        self._samples, self._caster = samples, caster
        lit = direct[direct[:, 1] > 0.02]
        ambient = (0.3 * lit.mean(axis=0) if len(lit) else np.full(3, 0.2)).astype(np.float32)
        self._world = (
            surfaces.normals,
            surfaces.materials,
            surfaces.mean_colors,
            starts_of(steps),
            steps,
            samples.of_node,
            direct,
            ambient,
        )
        self.bounced = np.zeros((len(samples.points), 3), dtype=np.float32)
        self.reach = np.zeros(len(samples.points), dtype=np.float32)
        self.close = np.zeros(len(samples.points), dtype=np.float32)

    def gather(self, chosen: NDArray[np.int64], rays_each: int, weight: float, tell: Callable[[float], None]) -> None:
        """Casts so many rays from each of the ``chosen`` samples and blends what they bring in with ``weight``."""
        points, normals = self._samples.points, self._samples.normals
        chunk = _RAYS_AT_ONCE // rays_each
        for begin in range(0, len(chosen), chunk):
            tell(begin / len(chosen))
            part = chosen[begin : begin + chunk]
            rays = np.empty((len(part), rays_each, 6), dtype=np.float32)
            in_bands(hemisphere_rays, len(part), part, points, normals, rays)
            hits = self._caster.cast_rays(rays)
            in_bands(
                shading.gather,
                len(part),
                part,
                weight,
                rays,
                hits.t,
                hits.triangle,
                hits.uv,
                *self._world,
                self.bounced,
                self.reach,
                self.close,
            )
