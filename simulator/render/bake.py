"""Static light, computed once per building: shadows of lamps and windows, and light bounced between surfaces.

Light is stored on a triangular grid on every triangle (``light_map``). Nodes that lie together and face alike share one
sample (``light_samples``), so finely modelled furniture costs little. A sample's light is

    direct + bounced,   bounced = mean over cosine-distributed rays of (colour they hit) x (its direct light + ambient)

which makes ambient occlusion, colour bleeding and dim corners come out by themselves. Everything random is a hash of
the sample's index: the same building gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.bounced_light import bounced_light
from surveilnav.simulator.render.direct_light import CHUNK, direct_light
from surveilnav.simulator.render.hashed import hemisphere_rays
from surveilnav.simulator.render.light_map import (
    VERSION,
    LightMap,
    assembled,
    read_light,
    starts_of,
    steps_of,
    write_light,
)
from surveilnav.simulator.render.light_samples import samples_of
from surveilnav.simulator.render.lights import Lights, lights_of
from surveilnav.simulator.render.surfaces import Surfaces
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Scene
from surveilnav.storage import file_lock

Progress = Callable[[float, str], None]


def load_or_bake(
    scene: Scene, caster: RayCaster, surfaces: Surfaces, cache_dir: Path | None, progress: Progress | None = None
) -> LightMap:
    """The light of a scene from ``cache_dir``, else baked and kept there (unless it has no content hash)."""
    if cache_dir is None or not scene.content_hash:
        return bake(scene, caster, surfaces, progress)
    path = Path(cache_dir) / "light" / f"{scene.content_hash}-{VERSION}.light"
    steps = steps_of(surfaces)
    found = read_light(path, steps)
    if found is not None:
        return found
    with file_lock(
        path.with_suffix(".lock")
    ):  # of several processes that need this light, one bakes and the others wait
        found = read_light(path, steps)
        if found is not None:
            return found
        baked = bake(scene, caster, surfaces, progress)
        write_light(path, baked)
        return baked


def bake(scene: Scene, caster: RayCaster, surfaces: Surfaces, progress: Progress | None = None) -> LightMap:
    """Computes the light of a scene; ``progress(fraction, what)`` is called about once a second."""
    tell = progress or (lambda fraction, what: None)
    steps = steps_of(surfaces)
    if len(steps) == 0:
        return LightMap(starts_of(steps), steps, np.zeros((1, 2, 3), np.uint8))
    tell(0.0, "light: placing samples")
    lights = lights_of(scene, caster)
    samples = samples_of(surfaces, steps)
    direct = direct_light(
        samples.points, samples.normals, lights, caster, lambda f: tell(0.05 + 0.35 * f, "light: shadows")
    )
    bounced, buried = bounced_light(
        samples, direct, steps, surfaces, caster, lambda f: tell(0.40 + 0.55 * f, "light: bounces")
    )
    tell(0.95, "light: storing")
    light = assembled(steps, samples.of_node, direct, bounced, buried)
    tell(1.0, "light: done")
    return light


def light_at(
    points: NDArray[np.float32], normals: NDArray[np.float32], lights: Lights, caster: RayCaster
) -> NDArray[np.float32]:
    """Unbaked light (S, 3) float32 at points: lamps and windows with shadows, and ambient light with occlusion."""
    light = direct_light(points, normals, lights, caster, lambda fraction: None, points_per_light=1)
    lit = light[light[:, 1] > 0.02]
    ambient = 0.6 * lit.mean(axis=0) if len(lit) else np.full(3, 0.4, np.float32)
    for begin in range(0, len(points), CHUNK):
        p = points[begin : begin + CHUNK]
        rays = np.empty((len(p), 4, 6), dtype=np.float32)
        in_bands(hemisphere_rays, len(p), np.arange(begin, begin + len(p)), points, normals, rays)
        open_sky = ~caster.occluded_rays(rays, 0.6, tnear=1e-4)
        light[begin : begin + CHUNK] += open_sky.mean(axis=1, dtype=np.float32)[:, None] * ambient
    return light
