"""Couches, armchairs, chairs and stools."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.simulator.furniture.parametric import prism
from surveilnav.simulator.world.scene import Material
from training.detector.furniture.drawing import Drawing


def couch(p: Drawing) -> None:
    cloth, h = p.fabric(), p.h
    seat, back, arm = p.between(0.42, 0.58) * h, p.between(0.16, 0.32) * p.d, p.between(0.08, 0.25)
    foot = p.between(0.0, 0.18)
    if foot > 0.05:
        _short_legs(p, foot)
    p.box((-p.w / 2, p.w / 2), (-p.d / 2, p.d / 2), (foot, 0.8 * seat), cloth)
    p.box((-p.w / 2, p.w / 2), (p.d / 2 - back, p.d / 2), (0.8 * seat, h * p.between(0.85, 1.0)), cloth)
    left, right = (arm if p.chance(0.85) else 0.0 for _ in range(2))
    high = h * p.between(0.6, 0.85)
    if left:
        p.box((-p.w / 2, -p.w / 2 + left), (-p.d / 2, p.d / 2 - back), (0.8 * seat, high), cloth)
    if right:
        p.box((p.w / 2 - right, p.w / 2), (-p.d / 2, p.d / 2 - back), (0.8 * seat, high), cloth)
    _cushions(p, (-p.w / 2 + left, p.w / 2 - right), seat, p.d / 2 - back, cloth)
    if p.w > 1.3 and p.chance(0.35):  # a seat to lie on at one end
        out, wide = p.between(0.4, 0.8), 0.35 * p.w
        x0 = -p.w / 2 if p.chance(0.5) else p.w / 2 - wide
        p.box((x0, x0 + wide), (-p.d / 2 - out, -p.d / 2), (foot, seat), cloth)


def _short_legs(p: Drawing, foot: float) -> None:
    legs = p.wood_or_paint()
    for x in (-p.w / 2 + 0.08, p.w / 2 - 0.08):
        for y in (-p.d / 2 + 0.08, p.d / 2 - 0.08):
            p.post(x, y, 0.025, (0.0, foot), legs)


def _cushions(p: Drawing, between: tuple[float, float], seat: float, back_y: float, cloth: Material) -> None:
    """Cushions to sit on and to lean against between two arms, and small ones thrown on them."""
    low, high = between
    n = max(1, round((high - low) / p.between(0.5, 1.0)))
    cushion = cloth if p.chance(0.7) else p.fabric()
    leans, thick, tall = p.chance(0.8), p.between(0.08, 0.2), p.h * p.between(0.8, 1.02)
    for i in range(n):
        x = (low + i * (high - low) / n + 0.01, low + (i + 1) * (high - low) / n - 0.01)
        p.box(x, (-p.d / 2 - 0.02, back_y), (0.8 * seat, seat), cushion)
        if leans:
            p.box(x, (back_y - thick, back_y), (seat, tall), cushion)
    for _ in range(p.rng.integers(0, 4)):
        at, side = p.between(low, max(low + 0.01, high - 0.4)), min(0.4, high - low)
        p.box((at, at + side), (back_y - 0.25, back_y - 0.12), (seat, seat + 0.9 * side), p.fabric())


def chair(p: Drawing) -> None:
    style = p.rng.random()
    if style < 0.25:
        couch(p)  # an armchair
        return
    frame, cover = p.wood_or_paint(), p.fabric()
    seat = min(p.h, 0.46 * p.h if p.h > 0.75 else p.h * p.between(0.85, 1.0))
    round_seat, thick = p.chance(0.3), p.between(0.03, 0.1)
    if style < 0.55:
        _star_base(p, frame, seat - thick)
    else:
        _four_legs(p, frame, seat - thick)
    cover = cover if p.chance(0.6) else frame
    if round_seat:
        prism(p.mesh, 0, 0, 0.46 * p.w, 0.46 * p.w, seat - thick, seat, cover, p.d / p.w)
    else:
        p.box((-p.w / 2, p.w / 2), (-p.d / 2, p.d / 2), (seat - thick, seat), cover)
    if p.h <= seat + 0.12:
        return
    _back(p, seat, frame, cover)
    if p.chance(0.4):
        arm = seat + p.between(0.15, 0.25)
        for x in (-p.w / 2, p.w / 2 - 0.04):
            p.box((x, x + 0.04), (-p.d / 2 + 0.05, p.d / 2), (arm, arm + 0.03), frame)
            p.box((x, x + 0.04), (-p.d / 2 + 0.08, -p.d / 2 + 0.12), (seat, arm), frame)


def _four_legs(p: Drawing, frame: Material, top: float) -> None:
    r, inset, taper = p.between(0.012, 0.03), p.between(0.0, 0.06), p.between(0.6, 1.6)
    for x in (-p.w / 2 + inset + r, p.w / 2 - inset - r):
        for y in (-p.d / 2 + inset + r, p.d / 2 - inset - r):
            p.post(x, y, r, (0.0, top), frame, taper)
    if p.chance(0.5):
        z = top * p.between(0.2, 0.7)
        for x in (-p.w / 2 + inset, p.w / 2 - inset - 2 * r):
            p.box((x, x + 2 * r), (-p.d / 2 + inset, p.d / 2 - inset), (z, z + 0.03), frame)


def _star_base(p: Drawing, frame: Material, top: float) -> None:
    p.post(0, 0, p.between(0.02, 0.04), (0.06, top), frame)
    if p.chance(0.3):
        prism(p.mesh, 0, 0, 0.4 * p.w, 0.38 * p.w, 0.0, 0.03, frame)
        return
    n = int(p.rng.integers(4, 6))
    for i in range(n):
        c, s = math.cos(2 * math.pi * i / n), math.sin(2 * math.pi * i / n)
        for t in np.linspace(0.1, 0.45, 5):
            x, y = float(t) * p.w * c, float(t) * p.d * s
            p.box((x - 0.03, x + 0.03), (y - 0.03, y + 0.03), (0.05, 0.09), frame)
        p.post(0.45 * p.w * c, 0.45 * p.d * s, 0.03, (0.0, 0.06), frame)


def _back(p: Drawing, seat: float, frame: Material, cover: Material) -> None:
    thick, gap = p.between(0.02, 0.08), p.between(0.0, 0.15)
    y = (p.d / 2 - thick, p.d / 2)
    if p.chance(0.5):
        inset = p.between(0.0, 0.06)
        p.box((-p.w / 2 + inset, p.w / 2 - inset), y, (seat + gap, p.h), cover)
    else:
        for x in (-p.w / 2, p.w / 2 - 0.03):
            p.box((x, x + 0.03), y, (seat, p.h), frame)
        n, lying = int(p.rng.integers(2, 6)), p.chance(0.5)
        for i in range(n):
            if lying:
                z = seat + (i + 1) * (p.h - seat - 0.06) / n
                p.box((-p.w / 2, p.w / 2), y, (z, z + 0.05), frame)
            else:
                x = -p.w / 2 + (i + 1) * p.w / (n + 1)
                p.box((x - 0.012, x + 0.012), y, (seat, p.h), frame)
        p.box((-p.w / 2, p.w / 2), y, (p.h - 0.05, p.h), frame)
    if gap > 0:
        p.box((-0.03, 0.03), y, (seat, seat + gap), frame)
