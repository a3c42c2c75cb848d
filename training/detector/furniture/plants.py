"""Plants in pots: blades, bushes, small trees, flowers, cacti."""

from __future__ import annotations

import math

from surveilnav.simulator.furniture.parametric import prism
from surveilnav.simulator.world.scene import Material
from training.detector.furniture.drawing import Drawing
from training.detector.materials import glossy, painted, patterned


def plant(p: Drawing) -> None:
    pot, r = painted(p.rng) if p.chance(0.6) else patterned(p.rng), min(p.w, p.d) / 2
    tall = p.h * p.between(0.12, 0.4)
    narrow, wide = p.between(0.3, 0.7) * r, p.between(0.35, 0.75) * r
    if p.chance(0.25):
        p.box((-wide, wide), (-wide, wide), (0.0, tall), pot)
    else:
        prism(p.mesh, 0, 0, narrow, wide, 0.0, tall, pot)
    style = p.rng.random()
    if style < 0.1:
        _cactus(p, tall, r)
        return
    crown = tall if p.chance(0.6) else tall + 0.4 * (p.h - tall) * p.between(0.3, 1.2)
    if crown > tall:
        p.post(0, 0, p.between(0.01, 0.035), (tall, crown + 0.1 * p.h), Material("stem", (0.32, 0.24, 0.14)))
    _leaves(p, crown, r, blades=style < 0.5)
    if style > 0.8:
        _blossoms(p, crown, r)


def _leaves(p: Drawing, crown: float, r: float, *, blades: bool) -> None:
    """Blades rise from one point and bend; otherwise leaves fill a ball."""
    greens = [_green(p) for _ in range(3)]
    n = int(p.rng.integers(10, 30)) if blades else int(p.rng.integers(40, 130))
    middle = (crown + p.h) / 2
    for i in range(n):
        turn = p.between(0, 2 * math.pi)
        c, s = math.cos(turn), math.sin(turn)
        if blades:
            foot, reach = (0.0, 0.0, crown - 0.02), r * p.between(0.4, 1.0)
            tip = (reach * c, reach * s, crown + (p.h - crown) * p.between(0.3, 1.0))
            bend = (0.6 * reach * c, 0.6 * reach * s, max(tip[2], crown + 0.85 * (p.h - crown)))
            half = p.between(0.02, 0.2) * r
        else:
            up, out = p.between(-1, 1), p.between(0.2, 1.0)
            flat = math.sqrt(1 - up * up) * out * r
            foot = (0.7 * flat * c, 0.7 * flat * s, middle + 0.6 * up * out * (p.h - crown) / 2)
            tip = (flat * c, flat * s, middle + up * out * (p.h - crown) / 2 - p.between(0, 0.04))
            bend = ((foot[0] + tip[0]) / 2, (foot[1] + tip[1]) / 2, (foot[2] + tip[2]) / 2 + 0.02)
            half = p.between(0.06, 0.2) * r
        side = (-s * half, c * half)
        leaf = [
            foot,
            (bend[0] - side[0], bend[1] - side[1], bend[2]),
            tip,
            (bend[0] + side[0], bend[1] + side[1], bend[2]),
        ]
        p.mesh.quad(leaf, greens[i % 3])
        p.mesh.quad(leaf[::-1], greens[i % 3])


def _blossoms(p: Drawing, crown: float, r: float) -> None:
    colour = glossy(p.rng)
    for _ in range(p.rng.integers(4, 20)):
        turn, out = p.between(0, 2 * math.pi), r * p.between(0.2, 0.9)
        x, y, z = out * math.cos(turn), out * math.sin(turn), p.between(0.5 * (crown + p.h), p.h)
        size = p.between(0.015, 0.05)
        p.box((x - size, x + size), (y - size, y + size), (z - size, z + size), colour)


def _cactus(p: Drawing, tall: float, r: float) -> None:
    green = _green(p)
    for i in range(p.rng.integers(1, 4)):
        x, y = (0.0, 0.0) if i == 0 else (p.between(-0.4, 0.4) * r, p.between(-0.4, 0.4) * r)
        p.post(x, y, p.between(0.15, 0.4) * r, (tall, p.between(0.6, 1.0) * p.h), green, p.between(0.6, 1.0))


def _green(p: Drawing) -> Material:
    g = p.between(0.22, 0.6)
    return Material("leaf", (g * p.between(0.3, 0.9), g, g * p.between(0.2, 0.7)))
