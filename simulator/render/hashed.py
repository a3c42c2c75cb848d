"""The compiled inner loops that hash: noise of pixels, directions of rays, keys by which samples are found alike.

Everything random in a picture is a hash of an index and a seed: the same seed gives the same bytes on any number of
threads. The loops share a file because all inline ``mix``: numba's cache doesn't notice edits in other files.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

import numpy as np
from numba import njit

#: Samples lie so far off their surface [m].
_OFFSET_M = 0.004


@njit(nogil=True, cache=True, inline="always")
def mix(x):
    """SplitMix64's finaliser (Steele, Lea, Flood 2014): a good 64-bit hash."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@njit(nogil=True, cache=True, inline="always")
def normal(bits):
    """About N(0, 1) from 64 random bits: the sum of four 16-bit uniforms (Irwin-Hall), tails end at 3.46 sigma."""
    mask = np.uint64(0xFFFF)
    total = np.float64(bits & mask) + np.float64((bits >> np.uint64(16)) & mask)
    total += np.float64((bits >> np.uint64(32)) & mask) + np.float64(bits >> np.uint64(48))
    return (total / 65535.0 - 2.0) * 1.7320508


@njit(nogil=True, cache=True)
def add_noise(row0, row1, depth, out, fx, fy, cx, cy, seed, lateral, axial, per_m, z0, step, grazing, dropout):
    height, width = depth.shape
    golden = np.uint64(0x9E3779B97F4A7C15)
    key = mix(seed + golden)
    for row in range(row0, row1):
        y = (row - cy) / fy
        for col in range(width):
            bits = mix(key + np.uint64(row * width + col + 1) * golden)
            r, c = row, col
            if lateral > 0.0:
                jitter = mix(bits + golden)
                r += int(np.floor(normal(jitter) * lateral + 0.5))
                c += int(np.floor(normal(mix(jitter + golden)) * lateral + 0.5))
                r, c = min(max(r, 0), height - 1), min(max(c, 0), width - 1)
            z = depth[r, c]
            if not (z > 0.0):
                out[row, col] = 0.0
                continue
            # Neighbouring pixels on one smooth surface differ little; across an edge jitter really swaps surfaces,
            # but on a slanted plane it would only double the axial noise: keep the plane's own depth there.
            own = depth[row, col]
            if own > 0.0 and abs(own - z) < 0.05 * own:
                z = own
            uniform = np.float64(mix(bits + golden + golden) >> np.uint64(11)) / 9007199254740992.0
            if uniform < dropout:
                out[row, col] = 0.0
                continue
            if grazing > 0.0 and 0 < r < height - 1 and 0 < c < width - 1:
                # For a plane n.p = d the inverse depth is linear in the image: its slope gives the normal.
                wl, wr, wu, wd = depth[r, c - 1], depth[r, c + 1], depth[r - 1, c], depth[r + 1, c]
                if wl > 0.0 and wr > 0.0 and wu > 0.0 and wd > 0.0:
                    w = 1.0 / depth[r, c]
                    gx = 0.5 * (1.0 / wr - 1.0 / wl) * fx
                    gy = 0.5 * (1.0 / wd - 1.0 / wu) * fy
                    x = (c - cx) / fx
                    nz = w - gx * x - gy * ((r - cy) / fy)
                    # Only where the surface is one plane: an edge's slope says nothing about an angle.
                    flat = abs(1.0 / wr + 1.0 / wl - 2.0 * w) + abs(1.0 / wd + 1.0 / wu - 2.0 * w) < 0.02 * w
                    ray = np.sqrt(x * x + y * y + 1.0)
                    cosine = w / (np.sqrt(gx * gx + gy * gy + nz * nz) * ray + 1e-12)
                    if flat and cosine < grazing:
                        out[row, col] = 0.0
                        continue
            z = z + normal(bits) * (axial + per_m * (z - z0) * (z - z0))
            if step > 0.0 and z > 0.0:
                disparity = np.floor(1.0 / (z * step) + 0.5) * step
                z = 1.0 / disparity if disparity > 0.0 else 0.0
            out[row, col] = max(z, 0.0)


@njit(nogil=True, cache=True)
def place_nodes(tri0, tri1, corners, normals, corner_normals, start, steps, low, instances, points, out_normals, keys):
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
                    keys[k, side] = mix(mix(place | np.uint64(facing)) + np.uint64(2 * np.int64(instances[t]) + side))
                k += 1


@njit(nogil=True, cache=True)
def shadow_rays(pair0, pair1, sample, light, begin, points, normals, position, extent, axis, rays, value):
    """Rays from samples to points on lights, and what they bring if nothing stands between (without colour)."""
    count = rays.shape[1]
    for pair in range(pair0, pair1):
        s, k = sample[pair], light[pair]
        bits = mix(np.uint64(begin + s) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(k + 1))
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
def hemisphere_rays(row0, row1, samples, points, normals, rays):
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
        bits = mix(np.uint64(s * 64 + count) * np.uint64(0x9E3779B97F4A7C15))
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
