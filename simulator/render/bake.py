"""Static light, computed once per building: shadows of lamps and windows, and light bounced between surfaces.

Light is stored on a triangular grid on every triangle, both sides ("mesh colors": Yuksel, Keyser, House 2010), fine
enough that shadows show on large floors and walls. Nodes that lie together and face alike share one sample, so
finely modelled furniture costs little. A sample's light is

    direct + bounced,   bounced = mean over cosine-distributed rays of (colour they hit) x (its direct light + ambient)

which makes ambient occlusion, colour bleeding and dim corners come out by themselves. Everything random is a hash of
the sample's index: the same building gives the same bytes.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard
from numba import njit
from numpy.typing import NDArray

from simulator.render import shading
from simulator.render.depth_noise import _mix
from simulator.render.lights import Lights, lights_of
from simulator.render.shading import LIGHT_MAX, Surfaces, in_bands
from simulator.world.raycast import RayCaster
from simulator.world.scene import Scene
from surveilnav.stored import locked, read_parts, write_parts

VERSION = 2
_TEXEL_M = 0.06
_MAX_STEPS = 128
_MAX_NODES = 8_000_000
_CHUNK = 1 << 16
_LIGHTS_PER_SAMPLE = 6
_FIRST_RAYS = 8
_OFFSET_M = 0.004

Progress = Callable[[float, str], None]


class LightMap(NamedTuple):
    """Light on every opaque triangle (T of them).

    ``steps`` (T,) int16: subdivisions of each edge; ``start`` (T,) int64: a triangle's first node;
    ``light`` (nodes, 2, 3) uint8: light of front and back, coded as ``shading.LIGHT_OF_BYTE``.
    """

    start: NDArray[np.int64]
    steps: NDArray[np.int16]
    light: NDArray[np.uint8]


def load_or_bake(
    scene: Scene, caster: RayCaster, surfaces: Surfaces, cache_dir: Path | None, progress: Progress | None = None
) -> LightMap:
    """The light of a scene from ``cache_dir``, else baked and kept there (unless it has no content hash)."""
    if cache_dir is None or not scene.content_hash:
        return bake(scene, caster, surfaces, progress)
    kind = f"surveilnav light {VERSION}".encode()
    path = Path(cache_dir) / "light" / f"{scene.content_hash}-{VERSION}.light"
    steps = steps_of(surfaces)
    found = _read(path, kind, steps)
    if found is not None:
        return found
    with locked(path.with_suffix(".lock")):  # of several processes that need this light, one bakes and the others wait
        found = _read(path, kind, steps)
        if found is not None:
            return found
        baked = bake(scene, caster, surfaces, progress)
        planes = np.ascontiguousarray(baked.light.transpose(1, 2, 0))  # like beside like: packs better
        packed = zstandard.ZstdCompressor(level=3).compress(planes.tobytes())
        write_parts(path, kind, [baked.steps.astype("<i2").tobytes(), packed])
        return baked


def _read(path: Path, kind: bytes, steps: NDArray[np.int16]) -> LightMap | None:
    parts = read_parts(path, kind)
    if parts is None or parts[0] != steps.astype("<i2").tobytes():
        return None
    light = np.frombuffer(zstandard.ZstdDecompressor().decompress(parts[1]), dtype=np.uint8)
    return LightMap(starts_of(steps), steps, np.ascontiguousarray(light.reshape(2, 3, -1).transpose(2, 0, 1)))


def starts_of(steps: NDArray[np.integer]) -> NDArray[np.int64]:
    """First node (T,) of each triangle: one of n steps has (n + 1)(n + 2) / 2 nodes."""
    counts = (steps.astype(np.int64) + 1) * (steps.astype(np.int64) + 2) // 2
    return np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else np.zeros(0, np.int64)


def steps_of(surfaces: Surfaces) -> NDArray[np.int16]:
    """Subdivisions (T,) of each triangle so that nodes lie at most 6 cm apart; coarser in enormous buildings."""
    c = surfaces.corners
    longest = np.sqrt(np.maximum.reduce([((c[:, i] - c[:, (i + 1) % 3]) ** 2).sum(axis=1) for i in range(3)] or [0.0]))
    texel_m = _TEXEL_M
    while True:
        steps: NDArray[np.int16] = np.clip(np.ceil(longest / texel_m), 1, _MAX_STEPS).astype(np.int16)
        wide = steps.astype(np.int64)
        if ((wide + 1) * (wide + 2) // 2).sum() <= max(_MAX_NODES, 4 * len(steps)):
            return steps
        texel_m *= 1.25


def bake(scene: Scene, caster: RayCaster, surfaces: Surfaces, progress: Progress | None = None) -> LightMap:
    """Computes the light of a scene; ``progress(fraction, what)`` is called about once a second."""
    tell = progress or (lambda fraction, what: None)
    steps = steps_of(surfaces)
    start = starts_of(steps)
    nodes = int(start[-1] + (int(steps[-1]) + 1) * (int(steps[-1]) + 2) // 2) if len(steps) else 0
    if nodes == 0:
        return LightMap(start, steps, np.zeros((1, 2, 3), np.uint8))
    tell(0.0, "light: placing samples")
    lights = lights_of(scene, caster)
    sample_of_node, points, normals = _samples(surfaces, start, steps, nodes)
    direct = _direct(points, normals, lights, caster, lambda f: tell(0.05 + 0.35 * f, "light: shadows"))
    bounced, buried = _bounced(
        points, normals, direct, sample_of_node, start, steps, surfaces, caster,
        lambda f: tell(0.40 + 0.55 * f, "light: bounces"),
    )  # fmt: skip
    tell(0.95, "light: storing")
    light = np.empty((nodes, 2, 3), dtype=np.uint8)
    in_bands(_assemble, len(steps), start, steps, sample_of_node, direct, bounced, buried, light)
    tell(1.0, "light: done")
    return LightMap(start, steps, light)


def light_at(
    points: NDArray[np.float32], normals: NDArray[np.float32], lights: Lights, caster: RayCaster
) -> NDArray[np.float32]:
    """Unbaked light (S, 3) float32 at points: lamps and windows with shadows, and ambient light with occlusion."""
    light = _direct(points, normals, lights, caster, lambda fraction: None, points_per_light=1)
    lit = light[light[:, 1] > 0.02]
    ambient = 0.6 * lit.mean(axis=0) if len(lit) else np.full(3, 0.4, np.float32)
    for begin in range(0, len(points), _CHUNK):
        p = points[begin : begin + _CHUNK]
        rays = np.empty((len(p), 4, 6), dtype=np.float32)
        in_bands(_hemisphere_rays, len(p), np.arange(begin, begin + len(p)), points, normals, rays)
        open_sky = ~caster.occluded_rays(rays, 0.6, tnear=1e-4)
        light[begin : begin + _CHUNK] += open_sky.mean(axis=1, dtype=np.float32)[:, None] * ambient
    return light


def _samples(
    surfaces: Surfaces, start: NDArray[np.int64], steps: NDArray[np.int16], nodes: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Merges nodes that lie and face alike.

    Returns the sample of each node and side (nodes, 2) int32, and the samples' points and normals (S, 3) float32.
    """
    corner_normals = _smooth_normals(surfaces)
    points = np.empty((nodes, 2, 3), dtype=np.float32)
    normals = np.empty((nodes, 2, 3), dtype=np.float32)
    keys = np.empty((nodes, 2), dtype=np.uint64)
    low = surfaces.corners.reshape(-1, 3).min(axis=0)
    in_bands(
        _place, len(steps), surfaces.corners, surfaces.normals, corner_normals, start, steps, low, surfaces.instances,
        points, normals, keys,
    )  # fmt: skip
    _, first, inverse = np.unique(keys.ravel(), return_index=True, return_inverse=True)
    sample_of_node = inverse.reshape(nodes, 2).astype(np.int32)
    return sample_of_node, points.reshape(-1, 3)[first].copy(), normals.reshape(-1, 3)[first].copy()


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


@njit(nogil=True, cache=True)
def _place(tri0, tri1, corners, normals, corner_normals, start, steps, low, instances, points, out_normals, keys):
    """Position, normal and merging key of each node's two sides."""
    cell = 0.03
    for t in range(tri0, tri1):
        n = steps[t]
        k = start[t]
        cx = (corners[t, 0, 0] + corners[t, 1, 0] + corners[t, 2, 0]) / 3
        cy = (corners[t, 0, 1] + corners[t, 1, 1] + corners[t, 2, 1]) / 3
        cz = (corners[t, 0, 2] + corners[t, 1, 2] + corners[t, 2, 2]) / 3
        for i in range(n + 1):
            for j in range(n + 1 - i):
                b1, b2 = i / n, j / n
                b0 = 1.0 - b1 - b2
                x = b0 * corners[t, 0, 0] + b1 * corners[t, 1, 0] + b2 * corners[t, 2, 0]
                y = b0 * corners[t, 0, 1] + b1 * corners[t, 1, 1] + b2 * corners[t, 2, 1]
                z = b0 * corners[t, 0, 2] + b1 * corners[t, 1, 2] + b2 * corners[t, 2, 2]
                mx = b0 * corner_normals[t, 0, 0] + b1 * corner_normals[t, 1, 0] + b2 * corner_normals[t, 2, 0]
                my = b0 * corner_normals[t, 0, 1] + b1 * corner_normals[t, 1, 1] + b2 * corner_normals[t, 2, 1]
                mz = b0 * corner_normals[t, 0, 2] + b1 * corner_normals[t, 1, 2] + b2 * corner_normals[t, 2, 2]
                length = np.sqrt(mx * mx + my * my + mz * mz)
                if length < 1e-6:
                    mx, my, mz, length = normals[t, 0], normals[t, 1], normals[t, 2], 1.0
                mx, my, mz = mx / length, my / length, mz / length
                # Away from the edges, where other surfaces touch: up to 15 mm towards the middle.
                ex, ey, ez = cx - x, cy - y, cz - z
                pull = np.sqrt(ex * ex + ey * ey + ez * ez)
                pull = min(0.015 / pull, 0.5) if pull > 1e-9 else 0.0
                x, y, z = x + pull * ex, y + pull * ey, z + pull * ez
                place = np.uint64((x - low[0]) / cell + 1.0) << np.uint64(46)
                place |= (np.uint64((y - low[1]) / cell + 1.0) & np.uint64(0x3FFFF)) << np.uint64(28)
                place |= (np.uint64((z - low[2]) / cell + 1.0) & np.uint64(0x3FFFF)) << np.uint64(10)
                for side in range(2):
                    sign = 1.0 if side == 0 else -1.0
                    lift = sign * _OFFSET_M
                    points[k, side, 0] = x + lift * normals[t, 0]
                    points[k, side, 1] = y + lift * normals[t, 1]
                    points[k, side, 2] = z + lift * normals[t, 2]
                    out_normals[k, side, 0] = sign * mx
                    out_normals[k, side, 1] = sign * my
                    out_normals[k, side, 2] = sign * mz
                    facing = int(np.floor(sign * mx * 4 + 4.5)) * 81 + int(np.floor(sign * my * 4 + 4.5)) * 9
                    facing += int(np.floor(sign * mz * 4 + 4.5))
                    # A rug's upper side, the inside of its lower one and the floor lie together and face alike:
                    # only the same sides of one instance may share.
                    keys[k, side] = _mix(_mix(place | np.uint64(facing)) + np.uint64(2 * np.int64(instances[t]) + side))
                k += 1


def _direct(
    points: NDArray[np.float32], normals: NDArray[np.float32], lights: Lights, caster: RayCaster,
    tell: Callable[[float], None], points_per_light: int = 4,
) -> NDArray[np.float32]:  # fmt: skip
    """Light (S, 3) float32 that reaches each point straight from lamps and windows."""
    direct = np.zeros((len(points), 3), dtype=np.float32)
    if not len(lights.position):
        return direct
    for begin in range(0, len(points), _CHUNK):
        tell(begin / len(points))
        p, n = points[begin : begin + _CHUNK], normals[begin : begin + _CHUNK]
        chosen = np.full((len(p), _LIGHTS_PER_SAMPLE), -1, dtype=np.int32)
        in_bands(_choose_lights, len(p), p, n, lights.position, lights.normal, lights.color, chosen)
        sample, slot = np.nonzero(chosen >= 0)
        light = chosen[sample, slot]
        rays = np.empty((len(sample), points_per_light, 6), dtype=np.float32)
        value = np.empty((len(sample), points_per_light), dtype=np.float32)
        in_bands(
            _shadow_rays, len(sample), sample, light, begin, p, n, lights.position, lights.extent, lights.normal, rays,
            value,
        )  # fmt: skip
        # The last centimetres before a light are free: lamps hang in their own shades, windows stand in frames.
        value[caster.occluded_rays(rays, 0.93, tnear=1e-4)] = 0.0
        _add_up(sample, light, value.mean(axis=1), lights.color, direct[begin : begin + _CHUNK])
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
def _shadow_rays(pair0, pair1, sample, light, begin, points, normals, position, extent, axis, rays, value):
    """Rays from samples to points on lights, and what they bring if nothing stands between (without colour)."""
    count = rays.shape[1]
    for pair in range(pair0, pair1):
        s, k = sample[pair], light[pair]
        bits = _mix(np.uint64(begin + s) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(k + 1))
        u0 = (bits & np.uint64(0xFFFF)) / 65536.0
        v0 = ((bits >> np.uint64(16)) & np.uint64(0xFFFF)) / 65536.0
        for q in range(count):
            # Points of the R2 sequence (Roberts 2018), shifted at random: even over the light for any count.
            a = (u0 + q * 0.7548776662) % 1.0 * 2.0 - 1.0
            b = (v0 + q * 0.5698402910) % 1.0 * 2.0 - 1.0
            d2 = 0.0
            cosine = 0.0
            shine = 0.0
            for i in range(3):
                d = position[k, i] + a * extent[k, 0, i] + b * extent[k, 1, i] - points[s, i]
                rays[pair, q, i] = points[s, i]
                rays[pair, q, 3 + i] = d
                d2 += d * d
                cosine += d * normals[s, i]
                shine += d * axis[k, i]
            length = np.sqrt(d2 + 1e-9)
            shine = 1.0 if axis[k, 0] == 0.0 and axis[k, 1] == 0.0 else abs(shine) / length
            value[pair, q] = max(cosine / length, 0.0) * shine / (d2 + 0.25)


@njit(nogil=True, cache=True)
def _add_up(sample, light, value, color, out):
    for pair in range(sample.shape[0]):
        for c in range(3):
            out[sample[pair], c] += value[pair] * color[light[pair], c]


def _bounced(
    points: NDArray[np.float32], normals: NDArray[np.float32], direct: NDArray[np.float32],
    sample_of_node: NDArray[np.int32], start: NDArray[np.int64], steps: NDArray[np.int16], surfaces: Surfaces,
    caster: RayCaster, tell: Callable[[float], None],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:  # fmt: skip
    """Light (S, 3) that reaches each sample by way of other surfaces and the sky; (S,) whether it lies inside one."""
    lit = direct[direct[:, 1] > 0.02]
    ambient = (0.3 * lit.mean(axis=0) if len(lit) else np.full(3, 0.2)).astype(np.float32)
    bounced = np.zeros((len(points), 3), dtype=np.float32)
    reach = np.zeros(len(points), dtype=np.float32)
    close = np.zeros(len(points), dtype=np.float32)

    def gather(chosen: NDArray[np.int64], rays_each: int, weight: float, begin_f: float, end_f: float) -> None:
        chunk = 1_000_000 // rays_each
        for begin in range(0, len(chosen), chunk):
            tell(begin_f + (end_f - begin_f) * begin / len(chosen))
            samples = chosen[begin : begin + chunk]
            rays = np.empty((len(samples), rays_each, 6), dtype=np.float32)
            in_bands(_hemisphere_rays, len(samples), samples, points, normals, rays)
            hits = caster.cast_rays(rays)
            in_bands(
                _gather, len(samples), samples, weight, rays, hits.t, hits.triangle, hits.uv, surfaces.normals,
                surfaces.materials, surfaces.mean_colors, start, steps, sample_of_node, direct, ambient, bounced, reach,
                close,
            )  # fmt: skip

    # A few rays tell what lies inside furniture and walls, where nobody will ever look; the rest is worth more.
    gather(np.arange(len(points)), _FIRST_RAYS, 1.0, 0.0, 0.3)
    buried = close > 0.9
    open_ = np.flatnonzero((reach > 0.4) | (direct[:, 1] > 0.0))
    more = int(np.clip(60_000_000 // max(len(open_), 1), 16, 32)) - _FIRST_RAYS
    gather(open_, more, more / (more + _FIRST_RAYS), 0.3, 1.0)
    return bounced, buried


@njit(nogil=True, cache=True)
def _hemisphere_rays(row0, row1, samples, points, normals, rays):
    """Cosine-distributed unit rays around each normal: a Fibonacci disc lifted to the hemisphere, turned at random."""
    count = rays.shape[1]
    for row in range(row0, row1):
        s = samples[row]
        nx, ny, nz = normals[s]
        # Branchless basis (Duff et al. 2017).
        sign = 1.0 if nz >= 0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        tx, ty, tz = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
        bx, by, bz = b, sign + ny * ny * a, -ny
        bits = _mix(np.uint64(s * 64 + count) * np.uint64(0x9E3779B97F4A7C15))
        turn = (bits >> np.uint64(40)) / 16777216.0 * 6.2831853
        for k in range(count):
            radius2 = (k + 0.5) / count
            radius = np.sqrt(radius2)
            angle = turn + k * 2.39996323
            u, v, w = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius2)
            for i in range(3):
                rays[row, k, i] = points[s, i]
            rays[row, k, 3] = u * tx + v * bx + w * nx
            rays[row, k, 4] = u * ty + v * by + w * ny
            rays[row, k, 5] = u * tz + v * bz + w * nz


@njit(nogil=True, cache=True)
def _gather(
    row0, row1, samples, weight, rays, t_hit, triangle, bary, tri_normals, materials, mean_colors, start, steps,
    sample_of_node, direct, ambient, out, reach, close,
):  # fmt: skip
    """Mean light along the rays of each sample, blended into ``out`` with ``weight``.

    ``reach``: the longest free way [m]; ``close``: the share of rays that end within 6 cm.
    """
    count = rays.shape[1]
    for row in range(row0, row1):
        s = samples[row]
        r, g, b, near, far = 0.0, 0.0, 0.0, 0, 0.0
        for k in range(count):
            dx, dy, dz = rays[row, k, 3], rays[row, k, 4], rays[row, k, 5]
            far = max(far, t_hit[row, k])
            t = np.int64(triangle[row, k])
            if t == 0xFFFFFFFF:
                sr, sg, sb = shading.sky(dx, dy, dz)
                r, g, b = r + 0.8 * sr, g + 0.8 * sg, b + 0.8 * sb
                continue
            near += t_hit[row, k] < 0.06
            facing = dx * tri_normals[t, 0] + dy * tri_normals[t, 1] + dz * tri_normals[t, 2]
            side = 0 if facing <= 0.0 else 1
            n = np.int64(steps[t])
            i = min(int(bary[row, k, 0] * n + 0.5), n)
            j = min(int(bary[row, k, 1] * n + 0.5), n - i)
            other = sample_of_node[start[t] + i * (n + 1) - (i * (i - 1)) // 2 + j, side]
            m = materials[t]
            r += mean_colors[m, 0] * (direct[other, 0] + ambient[0])
            g += mean_colors[m, 1] * (direct[other, 1] + ambient[1])
            b += mean_colors[m, 2] * (direct[other, 2] + ambient[2])
        out[s, 0] += weight * (r / count - out[s, 0])
        out[s, 1] += weight * (g / count - out[s, 1])
        out[s, 2] += weight * (b / count - out[s, 2])
        reach[s], close[s] = far, near / count


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
