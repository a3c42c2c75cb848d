"""Stored light: a triangular grid of nodes on every triangle, both sides, and its file.

"Mesh colors" (Yuksel, Keyser, House 2010), fine enough that shadows show on large floors and walls.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard
from numba import njit
from numpy.typing import NDArray

from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.surfaces import Surfaces
from surveilnav.simulator.render.tones import LIGHT_MAX
from surveilnav.storage import read_parts, write_parts

VERSION = 2
_KIND = f"surveilnav light {VERSION}".encode()
_TEXEL_M = 0.06
_MAX_STEPS = 128
_MAX_NODES = 8_000_000


class LightMap(NamedTuple):
    """Light on every opaque triangle (T of them).

    ``steps`` (T,) int16: subdivisions of each edge; ``start`` (T,) int64: a triangle's first node;
    ``light`` (nodes, 2, 3) uint8: light of front and back, coded as ``tones.LIGHT_OF_BYTE``.
    """

    start: NDArray[np.int64]
    steps: NDArray[np.int16]
    light: NDArray[np.uint8]


def nodes_of(steps: NDArray[np.integer]) -> int:
    """How many nodes the triangles have in all."""
    return int(_nodes(steps).sum())


def _nodes(steps: NDArray[np.integer]) -> NDArray[np.int64]:
    """Nodes (T,) of each triangle: one of n steps has (n + 1)(n + 2) / 2."""
    wide = steps.astype(np.int64)
    return (wide + 1) * (wide + 2) // 2


def starts_of(steps: NDArray[np.integer]) -> NDArray[np.int64]:
    """First node (T,) of each triangle."""
    return np.concatenate([[0], np.cumsum(_nodes(steps))[:-1]]) if len(steps) else np.zeros(0, np.int64)


def steps_of(surfaces: Surfaces) -> NDArray[np.int16]:
    """Subdivisions (T,) of each triangle so that nodes lie at most 6 cm apart; coarser in enormous buildings."""
    c = surfaces.corners
    longest = np.sqrt(np.maximum.reduce([((c[:, i] - c[:, (i + 1) % 3]) ** 2).sum(axis=1) for i in range(3)] or [0.0]))
    texel_m = _TEXEL_M
    while True:
        steps: NDArray[np.int16] = np.clip(np.ceil(longest / texel_m), 1, _MAX_STEPS).astype(np.int16)
        if nodes_of(steps) <= max(_MAX_NODES, 4 * len(steps)):
            return steps
        texel_m *= 1.25


def read_light(path: Path, steps: NDArray[np.int16]) -> LightMap | None:
    """The light in a file; None where there is none, it is damaged, or of triangles with other ``steps``."""
    parts = read_parts(path, _KIND)
    if parts is None or parts[0] != steps.astype("<i2").tobytes():
        return None
    light = np.frombuffer(zstandard.ZstdDecompressor().decompress(parts[1]), dtype=np.uint8)
    return LightMap(starts_of(steps), steps, np.ascontiguousarray(light.reshape(2, 3, -1).transpose(2, 0, 1)))


def write_light(path: Path, baked: LightMap) -> None:
    planes = np.ascontiguousarray(baked.light.transpose(1, 2, 0))  # like beside like: packs better
    packed = zstandard.ZstdCompressor(level=3).compress(planes.tobytes())
    write_parts(path, _KIND, [baked.steps.astype("<i2").tobytes(), packed])


def assembled(
    steps: NDArray[np.int16],
    sample_of_node: NDArray[np.int32],
    direct: NDArray[np.float32],
    bounced: NDArray[np.float32],
    buried: NDArray[np.bool_],
) -> LightMap:
    """The map of triangles with ``steps`` (T,) from the light of their samples.

    ``sample_of_node`` (nodes, 2) int32; ``direct`` and ``bounced`` (S, 3) float32; ``buried`` (S,): inside something.
    """
    start = starts_of(steps)
    light = np.empty((len(sample_of_node), 2, 3), dtype=np.uint8)
    in_bands(_assemble, len(steps), start, steps, sample_of_node, direct, bounced, buried, light)
    return LightMap(start, steps, light)


@njit(nogil=True, cache=True)
def _smooth_grid(n, rounds, value, good, spare, spare_good):
    """Averages ``value`` (nodes, 3) over neighbours on one triangle's grid, ``rounds`` times.

    Nodes that aren't ``good`` give nothing and take their neighbours' mean; grids under 4 steps are only filled so.
    """
    di = (0, 0, 1, -1, 1, -1)
    dj = (1, -1, 0, 0, -1, 1)
    nodes = (n + 1) * (n + 2) // 2
    for _ in range(rounds):
        k = 0
        for i in range(n + 1):
            for j in range(n + 1 - i):
                r, g, b, weight = 0.0, 0.0, 0.0, 0.0
                if good[k]:
                    r, g, b, weight = 2.0 * value[k, 0], 2.0 * value[k, 1], 2.0 * value[k, 2], 2.0
                if n >= 4 or not good[k]:
                    for q in range(6):
                        a, c = i + di[q], j + dj[q]
                        if a < 0 or c < 0 or a + c > n:
                            continue
                        other = a * (n + 1) - (a * (a - 1)) // 2 + c
                        if good[other]:
                            r, g, b = r + value[other, 0], g + value[other, 1], b + value[other, 2]
                            weight += 1.0
                spare_good[k] = weight > 0.0
                if weight > 0.0:
                    spare[k, 0], spare[k, 1], spare[k, 2] = r / weight, g / weight, b / weight
                else:
                    spare[k, 0], spare[k, 1], spare[k, 2] = value[k, 0], value[k, 1], value[k, 2]
                k += 1
        value[:nodes] = spare[:nodes]
        good[:nodes] = spare_good[:nodes]


@njit(nogil=True, cache=True)
def _assemble(tri0, tri1, start, steps, sample_of_node, direct, bounced, buried, light):
    """Stores the light of each node; what lies inside something (a floor below a wall) takes its neighbours' light.

    Bounced light is smooth: averaging over neighbours takes its noise away. Direct light is averaged once, which rounds
    the steps of its shadows.
    """
    size = (_MAX_STEPS + 1) * (_MAX_STEPS + 2) // 2
    straight, indirect, spare = np.empty((size, 3)), np.empty((size, 3)), np.empty((size, 3))
    good, spare_good = np.empty(size, dtype=np.bool_), np.empty(size, dtype=np.bool_)
    for t in range(tri0, tri1):
        n = np.int64(steps[t])
        nodes = (n + 1) * (n + 2) // 2
        for side in range(2):
            any_buried = False
            for k in range(nodes):
                s = sample_of_node[start[t] + k, side]
                good[k] = not buried[s]
                any_buried |= buried[s]
                for c in range(3):
                    straight[k, c], indirect[k, c] = direct[s, c], bounced[s, c]
            if n >= 4 or any_buried:
                _smooth_grid(n, 1, straight, good, spare, spare_good)
                for k in range(nodes):
                    good[k] = not buried[sample_of_node[start[t] + k, side]]
                _smooth_grid(n, 3, indirect, good, spare, spare_good)
            for k in range(nodes):
                for c in range(3):
                    value = (straight[k, c] + indirect[k, c]) / LIGHT_MAX
                    light[start[t] + k, side, c] = np.uint8(min(np.sqrt(value), 1.0) * 255.0 + 0.5)
