"""The compiled inner loops that know what surfaces and sky look like: pixels, and rays of bounced light.

Every pixel is computed alone (``bands``). ``shade`` and ``gather`` share a file because both inline ``sky``: numba's
cache doesn't notice edits in other files.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, no-check-untyped-defs
from __future__ import annotations

import numpy as np
from numba import njit


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
    row0,
    row1,
    stride,
    R,
    fx,
    fy,
    cx,
    cy,
    t_hit,
    triangle,
    bary,
    surfaces,
    mode,
    lightmap,
    pixel_light,
    linear,
    decode,
    exposure,
    tone,
    rgb,
    luminance,
):
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
def gather(
    row0,
    row1,
    samples,
    weight,
    rays,
    t_hit,
    triangle,
    bary,
    tri_normals,
    materials,
    mean_colors,
    start,
    steps,
    sample_of_node,
    direct,
    ambient,
    out,
    reach,
    close,
):
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
                sr, sg, sb = sky(dx, dy, dz)
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
