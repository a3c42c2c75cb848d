"""Beds: with and without boards at their ends, bunk beds, four-posters."""

from __future__ import annotations

import numpy as np

from surveilnav.simulator.world.scene import Material
from training.detector.furniture.drawing import Drawing


def bed(p: Drawing) -> None:
    if p.h > 1.3 and p.chance(0.8):
        _bunk_bed(p)
        return
    frame, top = p.wood_or_paint(), min(p.h, p.between(0.4, 0.6))
    head = p.between(0.03, 0.12) if p.chance(0.8) else 0.0
    foot = p.between(0.03, 0.08) if p.chance(0.4) else 0.0
    _lying(p, frame, 0.0, top, head, foot)
    if head:
        _panel(p, p.d / 2 - head, head, (0.0, max(p.h, top + 0.1)), frame)
    if foot:
        _panel(p, -p.d / 2, foot, (0.0, top + p.between(-0.1, 0.3)), frame)
    if p.chance(0.1):
        for x in (-p.w / 2 + 0.04, p.w / 2 - 0.04):
            for y in (-p.d / 2 + 0.04, p.d / 2 - 0.04):
                p.post(x, y, 0.035, (0.0, 2.0), frame)


def _bunk_bed(p: Drawing) -> None:
    frame, r = p.wood_or_paint(), p.between(0.025, 0.05)
    for x in (-p.w / 2 + r, p.w / 2 - r):
        for y in (-p.d / 2 + r, p.d / 2 - r):
            p.box((x - r, x + r), (y - r, y + r), (0.0, p.h), frame)
    lower = p.chance(0.7)
    for low, top in ((0.2, 0.45), (0.62 * p.h, 0.62 * p.h + 0.25))[0 if lower else 1 :]:
        _lying(p, frame, low, top, r, r)
    for z in (0.8 * p.h, p.h - 0.04):
        p.box((-p.w / 2, p.w / 2), (p.d / 2 - r, p.d / 2), (z, z + 0.04), frame)
        p.box((-p.w / 2, -p.w / 2 + r), (-p.d / 2, p.d / 2), (z, z + 0.04), frame)
    for z in np.arange(0.3, 0.7 * p.h, 0.28):
        p.box((p.w / 2 - r, p.w / 2), (-p.d / 2, -p.d / 2 + 0.4), (float(z), float(z) + 0.04), frame)


def _lying(p: Drawing, frame: Material, low: float, top: float, head: float, foot: float) -> None:
    """Frame, mattress, blanket and pillows between two heights."""
    y, thick = (-p.d / 2 + foot, p.d / 2 - head), p.between(0.12, 0.25)
    under = max(low + 0.02, top - thick)
    if p.chance(0.3) and low == 0.0:
        for x in (-p.w / 2 + 0.05, p.w / 2 - 0.05):
            for at in (y[0] + 0.06, y[1] - 0.06):
                p.post(x, at, 0.03, (0.0, under), frame)
        p.box((-p.w / 2, p.w / 2), y, (under - 0.08, under), frame)
    else:
        p.box((-p.w / 2, p.w / 2), y, (low, under), frame)
    inset = p.between(0.0, 0.05)
    linen = p.linen()
    p.box((-p.w / 2 + inset, p.w / 2 - inset), (y[0] + inset, y[1] - 0.01), (under, top - 0.02), linen)
    if p.chance(0.85):
        reach, over = p.between(0.35, 1.0), p.between(-0.04, 0.03)
        hangs = p.between(0.1, 0.2) if p.chance(0.7) else p.between(0.2, 1.0) * (top - low)
        p.box(
            (-p.w / 2 - over, p.w / 2 + over),
            (y[0] - over, y[0] + reach * (y[1] - y[0])),
            (top - hangs, top + 0.02),
            p.fabric(),
        )
    if p.chance(0.2):
        return
    n, pillow = 1 if p.w < 1.15 else int(p.rng.integers(1, 5)), p.linen() if p.chance(0.7) else p.fabric()
    step = (p.w - 0.1) / max(1, min(n, 2))
    for i in range(n):
        x0, back, lean = -p.w / 2 + 0.08 + (i % 2) * step, p.between(0.0, 0.1) + 0.25 * (i // 2), p.between(0.06, 0.25)
        p.box((x0, x0 + step - 0.1), (y[1] - 0.42 - back, y[1] - 0.05 - back), (top, top + lean), pillow)


def _panel(p: Drawing, y: float, thick: float, z: tuple[float, float], material: Material) -> None:
    """The board at an end of a bed: whole, or of slats."""
    if p.chance(0.6):
        p.box((-p.w / 2, p.w / 2), (y, y + thick), z, material)
        return
    n = int(p.rng.integers(4, 12))
    for i in range(n + 1):
        x = -p.w / 2 + i * (p.w - 0.04) / n
        p.box((x, x + 0.04), (y, y + thick), z, material)
    p.box((-p.w / 2, p.w / 2), (y, y + thick), (z[1] - 0.06, z[1]), material)
