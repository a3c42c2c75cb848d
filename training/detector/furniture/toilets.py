"""Toilets: standing and hung, with and without a tank, the lid down, up or missing."""

from __future__ import annotations

from surveilnav.simulator.furniture.parametric import prism
from surveilnav.simulator.world.scene import Material
from training.detector.furniture.drawing import METAL, Drawing
from training.detector.materials import glossy


def toilet(p: Drawing) -> None:
    white = glossy(p.rng) if p.chance(0.12) else Material("ceramic", (p.between(0.85, 0.97),) * 3, shininess=0.4)
    seat_of = white if p.chance(0.6) else p.wood_or_paint()
    rim, hung = min(0.48, p.between(0.48, 0.56) * p.h), p.chance(0.3)
    tank = p.between(0.14, 0.24) if p.h > 0.55 else 0.0
    if tank:
        wide = p.between(0.8, 1.0) * p.w / 2
        p.box((-wide, wide), (p.d / 2 - tank, p.d / 2), (rim * p.between(0.75, 1.0), p.h - 0.03), white)
        p.box((-wide - 0.01, wide + 0.01), (p.d / 2 - tank - 0.01, p.d / 2), (p.h - 0.03, p.h), white)
        p.box((-0.03, 0.03), (p.d / 2 - tank / 2 - 0.03, p.d / 2 - tank / 2 + 0.03), (p.h, p.h + 0.01), METAL)
    back = p.d / 2 - tank
    length, middle = back + p.d / 2, (back - p.d / 2) / 2
    stretch = (0.5 * length) / (0.46 * p.w)
    foot = p.between(0.15, 0.25) if hung else 0.0
    narrow = p.between(0.45, 0.85)
    prism(p.mesh, 0, middle + 0.05, 0.46 * p.w * narrow, 0.46 * p.w, foot, rim - 0.04, white, stretch * 0.92, 14)
    prism(p.mesh, 0, middle, 0.46 * p.w, 0.46 * p.w, rim - 0.04, rim - 0.01, white, stretch, 14)
    p.box((-0.4 * p.w, 0.4 * p.w), (back - 0.25 * length, back), (foot, rim - 0.02), white)
    lid = p.rng.random()
    if lid < 0.6:
        prism(p.mesh, 0, middle, 0.47 * p.w, 0.45 * p.w, rim - 0.01, rim + p.between(0.01, 0.05), seat_of, stretch, 14)
        return
    hole = Material("water", (0.55, 0.58, 0.60))
    prism(p.mesh, 0, middle, 0.47 * p.w, 0.47 * p.w, rim - 0.01, rim + 0.01, seat_of, stretch, 14)
    prism(p.mesh, 0, middle - 0.02, 0.3 * p.w, 0.3 * p.w, rim + 0.01, rim + 0.012, hole, stretch, 14)
    if lid < 0.9:
        p.box((-0.44 * p.w, 0.44 * p.w), (back - 0.05, back - 0.02), (rim, rim + 0.85 * length), seat_of)
