"""The compiled inner loops of the renderer: surfaces, textures and light per pixel.

Kernels are plain ``@njit(nogil=True)`` over bands of rows and are spread over threads by ``in_bands``. Every pixel is
computed alone, so the number of threads can't change a picture, and neither threads nor forks can
upset a threading layer.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulator.world.scene import Material, Scene

#: Brightness of stored light: ``light = (byte / 255) ** 2 * LIGHT_MAX``, relative to mid exposure.
LIGHT_MAX = 4.0
_TONE_STEPS = 16384
_TONE_MAX = 4.0


_threads = os.cpu_count() or 1


def use_threads(n: int) -> None:
    """Renders on so many threads from now on: one where processes already fill the cores, as handing bands to threads
    then only costs. Pictures don't depend on it."""
    global _threads
    _threads = n


def threads() -> int:
    """What ``use_threads`` set; all cores unless it did."""
    return _threads


@lru_cache(maxsize=1)
def _pool(pid: int) -> ThreadPoolExecutor:  # keyed by process: a pool doesn't survive a fork
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="shading")


def in_bands(kernel: Callable[..., Any], rows: int, *args: Any) -> None:
    """Calls ``kernel(row0, row1, *args)`` over bands that cover ``range(rows)``, on all cores (``use_threads``)."""
    workers = _threads
    bands = min(rows, 4 * workers) if workers > 1 else 1
    if bands <= 1:
        kernel(0, rows, *args)
        return
    edges = [rows * i // bands for i in range(bands + 1)]
    futures = [_pool(os.getpid()).submit(kernel, a, b, *args) for a, b in pairwise(edges)]
    for future in futures:
        future.result()


class Surfaces(NamedTuple):
    """What shading needs of the opaque triangles, in the ray caster's order (T of them).

    Attributes:
        corners: (T, 3, 3) float32 [m, world].
        normals: (T, 3) float32 unit, by the right hand rule; zero for degenerate triangles.
        uvs: (T, 3, 2) float32, finite.
        materials: (T,) int32 into ``colors`` and ``texture``.
        instances: (T,) uint16.
        texels_per_m: (T,) float32, texture texels along a metre of surface (0: untextured).
        colors: (M, 3) float32 linear.
        texture: (M, 2) int32, first row in ``mips`` and number of levels (0: untextured).
        mips: (levels, 3) int64: offset into ``texels``, width, height.
        texels: (N, 3) uint8 sRGB, all levels of all textures after each other.
        mean_colors: (M, 3) float32 linear, colour times the texture's mean: for bounced light.
    """

    corners: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    materials: NDArray[np.int32]
    instances: NDArray[np.uint16]
    texels_per_m: NDArray[np.float32]
    colors: NDArray[np.float32]
    texture: NDArray[np.int32]
    mips: NDArray[np.int64]
    texels: NDArray[np.uint8]
    mean_colors: NDArray[np.float32]


def to_linear(srgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """Linear light of sRGB values 0-1 (IEC 61966-2-1)."""
    s = np.clip(np.nan_to_num(np.asarray(srgb, dtype=np.float64)), 0.0, 1.0)
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _to_srgb(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    x = np.clip(linear, 0.0, 1.0).astype(np.float64)
    return np.asarray(np.where(x <= 0.0031308, x * 12.92, 1.055 * x ** (1 / 2.4) - 0.055), dtype=np.float64)


#: Linear value of each sRGB byte.
LINEAR_OF_BYTE = to_linear(np.arange(256) / 255.0)
#: The same in quarter steps, for colours blended from bytes.
LINEAR_OF_QUARTER = to_linear(np.arange(1024) / 1020.0)
#: Light of each stored byte.
LIGHT_OF_BYTE = ((np.arange(256) / 255.0) ** 2 * LIGHT_MAX).astype(np.float32)


def _tone_curve() -> NDArray[np.uint8]:
    """sRGB byte of linear light: straight up to the middle tones, then a soft shoulder that reaches white at 4."""
    x = np.linspace(0.0, _TONE_MAX, _TONE_STEPS)
    knee = 0.55
    over = np.maximum(x - knee, 0.0) / (1.0 - knee)
    shoulder = knee + (1.0 - knee) * (1.0 - np.exp(-over)) / (1.0 - np.exp(-(_TONE_MAX - knee) / (1.0 - knee)))
    return np.round(255.0 * _to_srgb(np.where(x < knee, x, shoulder))).astype(np.uint8)


TONE = _tone_curve()


def surfaces_of(scene: Scene, triangle_index: NDArray[np.integer]) -> Surfaces:
    """Gathers what shading needs of the triangles ``triangle_index`` (T,) of a scene; tolerates sloppy data."""
    corners = np.ascontiguousarray(scene.vertices[scene.triangles[triangle_index]], dtype=np.float32).reshape(-1, 3, 3)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(np.float32)
    twice_area = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(twice_area, 1e-20)[:, None]
    uvs = np.nan_to_num(scene.uvs[triangle_index], nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32).reshape(-1, 3, 2)
    uvs -= np.floor(uvs.min(axis=1, keepdims=True))  # textures wrap; far coordinates would cost precision
    materials = scene.material_of_triangle[triangle_index].astype(np.int32)
    colors, texture, mips, texels, mean_colors = _pack_textures(scene.materials)

    edge1, edge2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    uv_area = np.abs(edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0])
    sizes = np.zeros(len(texture), dtype=np.float32)
    textured = texture[:, 1] > 0
    sizes[textured] = mips[texture[textured, 0], 1] * mips[texture[textured, 0], 2]
    texels_per_m = np.sqrt(uv_area * sizes[materials] / np.maximum(twice_area, 1e-12)).astype(np.float32)
    instances = np.ascontiguousarray(scene.instance_of_triangle[triangle_index], dtype=np.uint16)
    return Surfaces(
        corners, normals, uvs, materials, instances, texels_per_m, colors, texture, mips, texels, mean_colors
    )  # fmt: skip


def _pack_textures(materials: tuple[Material, ...]) -> tuple[Any, ...]:
    """All textures with their mip levels in one array; pictures shared by materials are packed once."""
    colors = to_linear(np.array([m.color for m in materials], dtype=np.float64).reshape(-1, 3))
    mean_colors = colors.copy()
    texture = np.zeros((len(materials), 2), dtype=np.int32)
    mips: list[tuple[int, int, int]] = []
    texels: list[NDArray[np.uint8]] = []
    packed: dict[int, tuple[int, int]] = {}
    offset = 0
    for index, material in enumerate(materials):
        picture = material.texture
        if picture is None or picture.ndim != 3 or picture.shape[2] < 3 or picture.size == 0:
            continue
        if id(picture) not in packed:
            first, level = len(mips), np.ascontiguousarray(picture[..., :3], dtype=np.uint8)
            while True:
                height, width = level.shape[:2]
                mips.append((offset, width, height))
                texels.append(level.reshape(-1, 3))
                offset += width * height
                if width == 1 and height == 1:
                    break
                level = cv2.resize(level, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_AREA)
            packed[id(picture)] = (first, len(mips) - first)
        texture[index] = packed[id(picture)]
        smallest = texels[packed[id(picture)][0] + packed[id(picture)][1] - 1][0]
        mean_colors[index] *= LINEAR_OF_BYTE[smallest]
    all_texels = np.concatenate(texels) if texels else np.zeros((1, 3), dtype=np.uint8)
    all_mips = np.array(mips or [(0, 1, 1)], dtype=np.int64)
    return colors, texture, all_mips, all_texels, mean_colors


@njit(nogil=True, cache=True)
def primary_rays(row0, row1, R, origin, fx, fy, cx, cy, rays):
    """Fills rays (H, W, 6): origin and direction in the world, of unit z in the camera, so that t is the depth."""
    width = rays.shape[1]
    for row in range(row0, row1):
        y = np.float32((row - cy) / fy)
        for col in range(width):
            x = np.float32((col - cx) / fx)
            for axis in range(3):
                rays[row, col, axis] = origin[axis]
                rays[row, col, 3 + axis] = R[axis, 0] * x + R[axis, 1] * y + R[axis, 2]


@njit(nogil=True, cache=True)
def sky(dx, dy, dz):
    """Linear colour of the outdoors along a unit direction: a bright hazy sky above, a dull ground below."""
    if dz >= 0.0:
        up = np.sqrt(min(dz, 1.0))
        return 0.95 - 0.45 * up, 0.97 - 0.30 * up, 1.0 - 0.05 * up
    down = min(-dz * 4.0, 1.0)
    return 0.95 - 0.67 * down, 0.97 - 0.67 * down, 1.0 - 0.76 * down


@njit(nogil=True, cache=True)
def flat_light(nx, ny, nz):
    """Light without shadows on a surface that faces (nx, ny, nz): from above, a little from the side."""
    return 0.62 + 0.22 * nz + 0.10 * nx + 0.06 * ny


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def shade(
    row0, row1, stride, R, fx, fy, cx, cy, t_hit, triangle, bary, surfaces, mode, lightmap, pixel_light, linear, decode,
    exposure, tone, rgb, luminance,
):  # fmt: skip
    """Colours of every ``stride``-th pixel of every ``stride``-th row, for rows row0 to row1 of the output.

    Exposed and with the tone curve into rgb (H, W, 3) uint8; without exposure (0) only their luminance, each at most
    1.5, into luminance (H, W) float32. ``mode``: 0 flat light, 1 baked (lightmap), 2 given per pixel (pixel_light
    (H, W, 3)).

    One long loop on purpose: handing arrays to a function per pixel costs more than all of its arithmetic.
    """
    _, normals, uvs, materials, _, texels_per_m, colors, texture, mips, texels, _ = surfaces
    start, steps, light = lightmap
    last = tone.shape[0] - 1
    scale = exposure * last / 4.0
    for out_row in range(row0, row1):
        row = out_row * stride
        y = (row - cy) / fy
        for out_col in range(luminance.shape[1]):
            col = out_col * stride
            x = (col - cx) / fx
            unit = 1.0 / np.sqrt(x * x + y * y + 1.0)
            dx = (R[0, 0] * x + R[0, 1] * y + R[0, 2]) * unit
            dy = (R[1, 0] * x + R[1, 1] * y + R[1, 2]) * unit
            dz = (R[2, 0] * x + R[2, 1] * y + R[2, 2]) * unit
            t = np.int64(triangle[row, col])
            if t == 0xFFFFFFFF:
                r, g, b = sky(dx, dy, dz)
                r, g, b = 1.6 * r, 1.6 * g, 1.6 * b
            else:
                nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
                facing = -(dx * nx + dy * ny + dz * nz)
                b1, b2 = np.float64(bary[row, col, 0]), np.float64(bary[row, col, 1])
                m = materials[t]
                r, g, b = np.float64(colors[m, 0]), np.float64(colors[m, 1]), np.float64(colors[m, 2])

                levels = texture[m, 1]
                if levels > 0:
                    # Bilinear in the mip level of the pixel's footprint: a compromise of its short and long axis.
                    span = texels_per_m[t] * t_hit[row, col] / (fx * np.sqrt(max(abs(facing), 0.1)))
                    level = texture[m, 0]
                    finest_left = levels - 1
                    while span > 1.5 and finest_left > 0:
                        span *= 0.5
                        level += 1
                        finest_left -= 1
                    offset, width, height = mips[level, 0], mips[level, 1], mips[level, 2]
                    b0 = 1.0 - b1 - b2
                    u = b0 * uvs[t, 0, 0] + b1 * uvs[t, 1, 0] + b2 * uvs[t, 2, 0]
                    v = 1.0 - (b0 * uvs[t, 0, 1] + b1 * uvs[t, 1, 1] + b2 * uvs[t, 2, 1])
                    tx = (u - np.floor(u)) * width - 0.5
                    ty = (v - np.floor(v)) * height - 0.5
                    xa, ya = int(np.floor(tx)), int(np.floor(ty))
                    ax, ay = tx - xa, ty - ya
                    xb, yb = xa + 1, ya + 1
                    xa, ya = (xa if xa >= 0 else width - 1), (ya if ya >= 0 else height - 1)
                    xb, yb = (xb if xb < width else 0), (yb if yb < height else 0)
                    w00, w01, w10, w11 = (1.0 - ax) * (1.0 - ay), ax * (1.0 - ay), (1.0 - ax) * ay, ax * ay
                    i00, i01 = offset + ya * width + xa, offset + ya * width + xb
                    i10, i11 = offset + yb * width + xa, offset + yb * width + xb
                    # Blended as stored, then made linear: a third of the look-ups, a difference nobody sees.
                    tr = w00 * texels[i00, 0] + w01 * texels[i01, 0] + w10 * texels[i10, 0] + w11 * texels[i11, 0]
                    tg = w00 * texels[i00, 1] + w01 * texels[i01, 1] + w10 * texels[i10, 1] + w11 * texels[i11, 1]
                    tb = w00 * texels[i00, 2] + w01 * texels[i01, 2] + w10 * texels[i10, 2] + w11 * texels[i11, 2]
                    r *= linear[int(tr * 4.0 + 0.5)]
                    g *= linear[int(tg * 4.0 + 0.5)]
                    b *= linear[int(tb * 4.0 + 0.5)]

                side = 0 if facing >= 0.0 else 1
                if mode == 1:
                    # Linear between the three nearest nodes of the triangle's grid. Row i has n + 1 - i nodes.
                    n = np.int64(steps[t])
                    gx, gy = b1 * n, b2 * n
                    i = min(int(gx), n - 1)
                    j = min(int(gy), n - 1 - i)
                    w1, w2 = gx - i, gy - j
                    below = start[t] + i * (n + 1) - (i * (i - 1)) // 2 + j
                    above = below + n + 1 - i
                    k0, k1, k2 = below, above, below + 1
                    if w1 + w2 > 1.0 and i + j < n - 1:
                        k0, k1, k2 = above + 1, below + 1, above
                        w1, w2 = 1.0 - w1, 1.0 - w2
                    w0 = 1.0 - w1 - w2
                    lr = w0 * decode[light[k0, side, 0]] + w1 * decode[light[k1, side, 0]]
                    lg = w0 * decode[light[k0, side, 1]] + w1 * decode[light[k1, side, 1]]
                    lb = w0 * decode[light[k0, side, 2]] + w1 * decode[light[k1, side, 2]]
                    r *= lr + w2 * decode[light[k2, side, 0]]
                    g *= lg + w2 * decode[light[k2, side, 1]]
                    b *= lb + w2 * decode[light[k2, side, 2]]
                elif mode == 2:
                    r *= pixel_light[row, col, 0]
                    g *= pixel_light[row, col, 1]
                    b *= pixel_light[row, col, 2]
                else:
                    sign = 1.0 if side == 0 else -1.0
                    flat = flat_light(sign * nx, sign * ny, sign * nz)
                    r, g, b = r * flat, g * flat, b * flat
            if exposure > 0.0:
                rgb[out_row, out_col, 0] = tone[max(min(int(r * scale), last), 0)]
                rgb[out_row, out_col, 1] = tone[max(min(int(g * scale), last), 0)]
                rgb[out_row, out_col, 2] = tone[max(min(int(b * scale), last), 0)]
            else:
                luminance[out_row, out_col] = min(0.2126 * r + 0.7152 * g + 0.0722 * b, 1.5)


@njit(nogil=True, cache=True)
def depth_and_instances(row0, row1, t_hit, triangle, instances, near, far, depth, ids):
    """Depth (0 where nothing is in [near, far]) and instance ids (0 where nothing was hit at all)."""
    for row in range(row0, row1):
        for col in range(depth.shape[1]):
            t = triangle[row, col]
            if t == 0xFFFFFFFF:
                depth[row, col] = 0.0
                ids[row, col] = 0
            else:
                z = t_hit[row, col]
                depth[row, col] = z if near <= z <= far else 0.0
                ids[row, col] = instances[t]
