"""Light that comes straight from lamps and windows, with shadows."""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.hashed import shadow_rays
from surveilnav.simulator.render.lights import Lights
from surveilnav.simulator.world.raycast import RayCaster

CHUNK = 1 << 16
_LIGHTS_PER_SAMPLE = 6


def direct_light(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    lights: Lights,
    caster: RayCaster,
    tell: Callable[[float], None],
    points_per_light: int = 4,
) -> NDArray[np.float32]:
    """Light (S, 3) float32 that reaches each point straight from lamps and windows."""
    direct = np.zeros((len(points), 3), dtype=np.float32)
    if not len(lights.position):
        return direct
    for begin in range(0, len(points), CHUNK):
        tell(begin / len(points))
        p, n = points[begin : begin + CHUNK], normals[begin : begin + CHUNK]
        chosen = np.full((len(p), _LIGHTS_PER_SAMPLE), -1, dtype=np.int32)
        in_bands(_choose_lights, len(p), p, n, lights.position, lights.normal, lights.color, chosen)
        sample, slot = np.nonzero(chosen >= 0)
        light = chosen[sample, slot]
        rays = np.empty((len(sample), points_per_light, 6), dtype=np.float32)
        value = np.empty((len(sample), points_per_light), dtype=np.float32)
        in_bands(
            shadow_rays,
            len(sample),
            sample,
            light,
            begin,
            p,
            n,
            lights.position,
            lights.extent,
            lights.normal,
            rays,
            value,
        )
        # The last centimetres before a light are free: lamps hang in their own shades, windows stand in frames.
        value[caster.occluded_rays(rays, 0.93, tnear=1e-4)] = 0.0
        _add_up(sample, light, value.mean(axis=1), lights.color, direct[begin : begin + CHUNK])
    return direct


@njit(nogil=True, cache=True)
def _choose_lights(row0, row1, points, normals, position, axis, color, chosen):
    """The strongest few lights at each point, shadows left aside."""
    slots = chosen.shape[1]
    strength = np.empty(slots)
    for s in range(row0, row1):
        found = 0
        for light in range(position.shape[0]):
            dx, dy = position[light, 0] - points[s, 0], position[light, 1] - points[s, 1]
            dz = position[light, 2] - points[s, 2]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 > 100.0 or abs(dz) > 3.5:
                continue
            cosine = (dx * normals[s, 0] + dy * normals[s, 1] + dz * normals[s, 2]) / np.sqrt(d2 + 1e-6)
            power = color[light, 1] * max(cosine + 0.1, 0.0) / (d2 + 0.25)
            if axis[light, 0] != 0.0 or axis[light, 1] != 0.0:
                power *= abs(dx * axis[light, 0] + dy * axis[light, 1]) / np.sqrt(d2 + 1e-6)
            if power < 0.01:
                continue
            k = found if found < slots else slots - 1
            if found == slots and strength[k] >= power:
                continue
            found = min(found + 1, slots)
            while k > 0 and strength[k - 1] < power:
                strength[k], chosen[s, k] = strength[k - 1], chosen[s, k - 1]
                k -= 1
            strength[k], chosen[s, k] = power, light


@njit(nogil=True, cache=True)
def _add_up(sample, light, value, color, out):
    for pair in range(sample.shape[0]):
        for c in range(3):
            out[sample[pair], c] += value[pair] * color[light[pair], c]
