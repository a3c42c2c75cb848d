"""Where light is computed: nodes of the light map that lie together and face alike share one sample."""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.simulator.render.bands import in_bands
from surveilnav.simulator.render.hashed import place_nodes
from surveilnav.simulator.render.light_map import nodes_of, starts_of
from surveilnav.simulator.render.surfaces import Surfaces


class Samples(NamedTuple):
    """The sample of each node and side (nodes, 2) int32, and the samples' points and normals (S, 3) float32 [m, world]."""

    of_node: NDArray[np.int32]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]


def samples_of(surfaces: Surfaces, steps: NDArray[np.int16]) -> Samples:
    """Merges nodes that lie and face alike."""
    corner_normals = _smooth_normals(surfaces)
    start, nodes = starts_of(steps), nodes_of(steps)
    points = np.empty((nodes, 2, 3), dtype=np.float32)
    normals = np.empty((nodes, 2, 3), dtype=np.float32)
    keys = np.empty((nodes, 2), dtype=np.uint64)
    low = surfaces.corners.reshape(-1, 3).min(axis=0)
    in_bands(
        place_nodes,
        len(steps),
        surfaces.corners,
        surfaces.normals,
        corner_normals,
        start,
        steps,
        low,
        surfaces.instances,
        points,
        normals,
        keys,
    )
    _, first, inverse = np.unique(keys.ravel(), return_index=True, return_inverse=True)
    of_node = inverse.reshape(nodes, 2).astype(np.int32)
    return Samples(of_node, points.reshape(-1, 3)[first].copy(), normals.reshape(-1, 3)[first].copy())


def _smooth_normals(surfaces: Surfaces) -> NDArray[np.float32]:
    """(T, 3, 3) normals of the corners: mean over the faces around that point within 45 degrees, weighted by area."""
    corners = surfaces.corners
    flat = corners.reshape(-1, 3)
    grid = np.round((flat - flat.min(axis=0)) / 5e-4).astype(np.uint64)
    keys = (grid[:, 0] << np.uint64(42)) ^ (grid[:, 1] << np.uint64(21)) ^ grid[:, 2]
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    begin = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    end = np.concatenate([begin[1:], [len(ordered)]])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1).astype(np.float32)
    out = np.empty_like(corners)
    in_bands(_smooth, len(begin), begin, end, order, surfaces.normals, area, out.reshape(-1, 3))
    return out


@njit(nogil=True, cache=True)
def _smooth(group0, group1, begin, end, order, normals, area, out):
    for group in range(group0, group1):
        last = min(end[group], begin[group] + 64)  # fans of hundreds of triangles: the first 64 say enough
        for a in range(begin[group], end[group]):
            face = order[a] // 3
            nx, ny, nz = normals[face]
            sx, sy, sz = nx * area[face], ny * area[face], nz * area[face]
            for b in range(begin[group], last):
                other = order[b] // 3
                if other == face:
                    continue
                dot = nx * normals[other, 0] + ny * normals[other, 1] + nz * normals[other, 2]
                if abs(dot) > 0.7:
                    weight = area[other] if dot > 0 else -area[other]  # winding of modelled furniture can't be trusted
                    sx += weight * normals[other, 0]
                    sy += weight * normals[other, 1]
                    sz += weight * normals[other, 2]
            length = np.sqrt(sx * sx + sy * sy + sz * sz)
            if length > 1e-12:
                out[order[a], 0], out[order[a], 1], out[order[a], 2] = sx / length, sy / length, sz / length
            else:
                out[order[a], 0], out[order[a], 1], out[order[a], 2] = nx, ny, nz
