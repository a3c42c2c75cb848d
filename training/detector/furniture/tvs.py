"""Televisions: flat ones on a foot, on two or none, and old ones with a tube."""

from __future__ import annotations

from surveilnav.simulator.world.scene import Material
from training.detector.furniture.drawing import Drawing
from training.detector.materials import glossy, patterned


def tv(p: Drawing) -> None:
    shell = Material("shell", (p.between(0.02, 0.25),) * 3, shininess=0.4) if p.chance(0.8) else glossy(p.rng)
    foot = p.between(0.04, 0.2) * p.h if p.chance(0.7) else 0.0
    bezel = p.between(0.008, 0.05)
    tube = p.chance(0.2)
    thick = p.d if tube else min(p.d, p.between(0.03, 0.1))
    y = (-thick / 2, thick / 2)
    if tube:
        p.box((-p.w / 2, p.w / 2), (y[0], y[0] + 0.35 * thick), (foot, p.h), shell)
        p.box((-0.36 * p.w, 0.36 * p.w), (y[0] + 0.35 * thick, y[1]), (foot + 0.1 * p.h, 0.9 * p.h), shell)
    else:
        p.box((-p.w / 2, p.w / 2), y, (foot, p.h), shell)
    if foot and p.chance(0.6):
        p.box((-0.05, 0.05), (-0.02, 0.02), (0.0, foot), shell)
        wide = p.between(0.15, 0.4) * p.w
        p.box((-wide, wide), (-p.d / 2, p.d / 2), (0.0, 0.02), shell)
    elif foot:
        for x in (-0.4 * p.w, 0.36 * p.w):
            p.box((x, x + 0.04 * p.w), (-p.d / 2, p.d / 2), (0.0, 0.02), shell)
            p.box((x, x + 0.04 * p.w), (-0.02, 0.02), (0.0, foot), shell)
    on = p.chance(0.4)
    screen = patterned(p.rng, "scene") if on else Material("screen", tuple(p.rng.uniform(0.02, 0.2, 3)), shininess=0.8)
    low, high, y0 = foot + p.between(0, 0.05) + bezel, p.h - bezel, y[0] - 0.003
    half = p.w / 2 - bezel
    p.mesh.quad(
        [(-half, y0, low), (half, y0, low), (half, y0, high), (-half, y0, high)],
        screen,
        [(0, 0), (1, 0), (1, 1), (0, 1)],
    )
