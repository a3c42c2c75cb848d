"""Furniture made of a few boxes: for homes without any assets, and where a model can't be had.

Local frame of a piece: x to its right, y to its back (it looks towards -y), z up; centred in x and y,
standing on z = 0; metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.scene import Material

Color = tuple[float, float, float]
_Maker = Callable[[MeshBuilder, float, float, float, np.random.Generator], None]

#: Width, depth, height [m] of a piece when nobody says otherwise.
SIZES_M: dict[str, tuple[float, float, float]] = {
    "bed": (1.6, 2.05, 0.95),
    "couch": (2.0, 0.9, 0.8),
    "chair": (0.45, 0.5, 0.9),
    "toilet": (0.38, 0.68, 0.78),
    "tv": (1.1, 0.2, 0.68),
    "potted plant": (0.55, 0.55, 1.1),
    "dining table": (1.4, 0.85, 0.74),
    "sink": (0.6, 0.48, 0.86),
    "refrigerator": (0.62, 0.65, 1.8),
    "oven": (0.6, 0.6, 0.88),
    "bathtub": (1.7, 0.75, 0.56),
    "bookshelf": (0.9, 0.32, 1.9),
    "lamp": (0.36, 0.36, 1.55),
    "cabinet": (1.2, 0.42, 0.5),
    "rug": (1.8, 1.3, 0.01),
    "stairs": (0.9, 2.4, 3.62),
}

_FABRICS: tuple[Color, ...] = (
    (0.30, 0.36, 0.48),
    (0.52, 0.22, 0.20),
    (0.36, 0.42, 0.32),
    (0.45, 0.45, 0.47),
    (0.58, 0.48, 0.36),
    (0.20, 0.24, 0.30),
)
_WOODS: tuple[Color, ...] = ((0.52, 0.36, 0.22), (0.40, 0.27, 0.17), (0.66, 0.50, 0.34), (0.78, 0.66, 0.50))
_CERAMIC = Material("ceramic", (0.93, 0.93, 0.92), shininess=0.4)
_METAL = Material("metal", (0.62, 0.63, 0.65), shininess=0.5)
_BLACK = Material("black", (0.04, 0.04, 0.05), shininess=0.4)
_STAIR_WOOD = Material("stairs", (0.55, 0.40, 0.26))
_LINEN = Material("linen", (0.92, 0.91, 0.88))


def _pick(name: str, colors: tuple[Color, ...], rng: np.random.Generator) -> Material:
    return Material(name, colors[int(rng.integers(len(colors)))])


def prism(
    mesh: MeshBuilder,
    x: float,
    y: float,
    r_low: float,
    r_high: float,
    z0: float,
    z1: float,
    material: Material,
    stretch_y: float = 1.0,
    sides: int = 12,
) -> None:
    """An upright round body of radius ``r_low`` below and ``r_high`` above."""
    at = [2 * math.pi * i / sides for i in range(sides)]
    low = [(x + r_low * math.cos(a), y + stretch_y * r_low * math.sin(a), z0) for a in at]
    high = [(x + r_high * math.cos(a), y + stretch_y * r_high * math.sin(a), z1) for a in at]
    for i in range(sides):
        j = (i + 1) % sides
        mesh.quad([low[i], low[j], high[j], high[i]], material)
    fan = np.array([[0, i, i + 1] for i in range(1, sides - 1)], dtype=np.int32)
    mesh.triangles(np.array(high), fan, material)
    mesh.triangles(np.array(low), fan[:, ::-1].copy(), material)


def _bed(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    wood, cover = _pick("wood", _WOODS, rng), _pick("fabric", _FABRICS, rng)
    lie = min(0.55, 0.55 * h)
    m.box((-w / 2, d / 2 - 0.06, 0), (w / 2, d / 2, h), wood)
    m.box((-w / 2, -d / 2, 0.08), (w / 2, d / 2 - 0.06, lie * 0.55), wood)
    m.box((-w / 2 + 0.03, -d / 2 + 0.03, lie * 0.55), (w / 2 - 0.03, d / 2 - 0.06, lie * 0.9), _LINEN)
    m.box((-w / 2, -d / 2, lie * 0.5), (w / 2, d / 2 - 0.65, lie), cover)
    count = 2 if w > 1.2 else 1
    for i in range(count):
        x0 = -w / 2 + 0.08 + i * (w - 0.08) / count
        m.box((x0, d / 2 - 0.55, lie * 0.9), (x0 + (w - 0.08) / count - 0.1, d / 2 - 0.12, lie + 0.1), _LINEN)


def _couch(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    fabric = _pick("fabric", _FABRICS, rng)
    seat, arm, back = 0.5 * h, 0.18 if w > 1.0 else 0.14, 0.25 * d
    m.box((-w / 2, -d / 2, 0.05), (w / 2, d / 2, 0.38 * h), fabric)
    m.box((-w / 2, d / 2 - back, 0.38 * h), (w / 2, d / 2, h), fabric)
    m.box((-w / 2, -d / 2, 0.38 * h), (-w / 2 + arm, d / 2 - back, 0.72 * h), fabric)
    m.box((w / 2 - arm, -d / 2, 0.38 * h), (w / 2, d / 2 - back, 0.72 * h), fabric)
    count = max(1, round((w - 2 * arm) / 0.7))
    step = (w - 2 * arm) / count
    for i in range(count):
        x0 = -w / 2 + arm + i * step
        m.box((x0 + 0.01, -d / 2 - 0.02, 0.38 * h), (x0 + step - 0.01, d / 2 - back, seat), fabric)
        m.box((x0 + 0.02, d / 2 - back - 0.12, seat), (x0 + step - 0.02, d / 2 - back, 0.92 * h), fabric)


def _chair(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    wood = _pick("wood", _WOODS, rng)
    seat, leg = 0.5 * h, 0.035
    for x in (-w / 2, w / 2 - leg):
        m.box((x, -d / 2, 0), (x + leg, -d / 2 + leg, seat), wood)
        m.box((x, d / 2 - leg, 0), (x + leg, d / 2, h), wood)
    m.box((-w / 2, -d / 2, seat - 0.04), (w / 2, d / 2, seat), wood)
    for z in (0.66, 0.8, 0.92):
        m.box((-w / 2, d / 2 - leg, z * h), (w / 2, d / 2 - 0.01, (z + 0.07) * h), wood)


def _toilet(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    del rng
    m.box((-w / 2, d / 2 - 0.2, 0.4 * h), (w / 2, d / 2, h), _CERAMIC)
    y, stretch = -0.1 * d, (0.39 * d) / (0.46 * w)
    prism(m, 0, y + 0.06, 0.28 * w, 0.36 * w, 0.0, 0.32 * h, _CERAMIC, stretch)
    prism(m, 0, y, 0.38 * w, 0.46 * w, 0.32 * h, 0.5 * h, _CERAMIC, stretch)
    prism(m, 0, y, 0.47 * w, 0.45 * w, 0.5 * h, 0.54 * h, _LINEN, stretch)


def _tv(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    del rng
    m.box((-0.2 * w, -d / 2, 0), (0.2 * w, d / 2, 0.02), _METAL)
    m.box((-0.03, -0.02, 0.02), (0.03, 0.02, 0.15 * h), _METAL)
    m.box((-w / 2, -0.03, 0.1 * h), (w / 2, 0.03, h), _BLACK)
    screen = Material("screen", (0.10, 0.13, 0.18), shininess=0.8)
    m.box((-w / 2 + 0.03, -0.035, 0.1 * h + 0.03), (w / 2 - 0.03, -0.03, h - 0.03), screen)


def _plant(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    pot = _pick("pot", ((0.62, 0.33, 0.22), (0.85, 0.83, 0.78), (0.30, 0.30, 0.32)), rng)
    radius = min(w, d) / 2
    prism(m, 0, 0, 0.35 * radius, 0.5 * radius, 0.0, 0.28 * h, pot)
    prism(m, 0, 0, 0.03, 0.02, 0.28 * h, 0.6 * h, Material("stem", (0.30, 0.22, 0.12)), sides=5)
    greens = tuple(Material("leaf", (0.10 + 0.05 * i, 0.32 + 0.08 * i, 0.10 + 0.03 * i)) for i in range(3))
    for i in range(42):
        turn, rise = 2.399963 * i, 0.36 + 0.5 * i / 42
        reach = radius * (0.95 - 0.5 * abs(rise - 0.55)) * float(rng.uniform(0.75, 1.0))
        c, s = math.cos(turn), math.sin(turn)
        foot, tip = (0.0, 0.0, rise * h), (reach * c, reach * s, min(h, (rise + 0.1) * h))
        wide = 0.22 * radius
        middle = (0.55 * reach * c, 0.55 * reach * s, (rise + 0.12) * h)
        side = (-s * wide, c * wide)
        leaf = [
            foot,
            (middle[0] - side[0], middle[1] - side[1], middle[2]),
            tip,
            (middle[0] + side[0], middle[1] + side[1], middle[2]),
        ]
        m.quad(leaf, greens[i % 3])
        m.quad(leaf[::-1], greens[i % 3])


def _table(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    wood = _pick("wood", _WOODS, rng)
    m.box((-w / 2, -d / 2, h - 0.04), (w / 2, d / 2, h), wood)
    for x in (-w / 2 + 0.04, w / 2 - 0.1):
        for y in (-d / 2 + 0.04, d / 2 - 0.1):
            m.box((x, y, 0), (x + 0.06, y + 0.06, h - 0.04), wood)


def _sink(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    del rng
    prism(m, 0, 0.1 * d, 0.16 * w, 0.2 * w, 0.0, h - 0.16, _CERAMIC)
    rim = 0.05
    m.box((-w / 2, -d / 2, h - 0.16), (w / 2, d / 2, h - 0.1), _CERAMIC)
    m.box((-w / 2, -d / 2, h - 0.1), (w / 2, -d / 2 + rim, h), _CERAMIC)
    m.box((-w / 2, d / 2 - 0.12, h - 0.1), (w / 2, d / 2, h), _CERAMIC)
    for x in (-w / 2, w / 2 - rim):
        m.box((x, -d / 2 + rim, h - 0.1), (x + rim, d / 2 - 0.12, h), _CERAMIC)
    m.box((-0.02, d / 2 - 0.18, h), (0.02, d / 2 - 0.03, h + 0.02), _METAL)


def _refrigerator(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    body = _pick("enamel", ((0.90, 0.90, 0.89), (0.70, 0.71, 0.73)), rng)
    m.box((-w / 2, -d / 2 + 0.03, 0), (w / 2, d / 2, h), body)
    for z0, z1 in ((0.04, 0.6 * h), (0.61 * h, h - 0.01)):
        m.box((-w / 2, -d / 2, z0), (w / 2, -d / 2 + 0.03, z1), body)
        m.box((-w / 2 + 0.04, -d / 2 - 0.03, z0 + 0.1), (-w / 2 + 0.07, -d / 2, z0 + 0.45), _METAL)


def _oven(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    del rng
    m.box((-w / 2, -d / 2, 0), (w / 2, d / 2, h), _CERAMIC)
    m.box((-w / 2 + 0.06, -d / 2 - 0.01, 0.2 * h), (w / 2 - 0.06, -d / 2, 0.72 * h), _BLACK)
    m.box((-w / 2 + 0.04, -d / 2 - 0.04, 0.76 * h), (w / 2 - 0.04, -d / 2 - 0.01, 0.79 * h), _METAL)
    for x in (-w / 4, w / 4):
        for y in (-d / 4, d / 4):
            prism(m, x, y, 0.09, 0.09, h, h + 0.01, _BLACK)


def _bathtub(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    del rng
    rim = 0.07
    m.box((-w / 2, -d / 2, 0), (w / 2, d / 2, 0.3 * h), _CERAMIC)
    for low, high in (
        ((-w / 2, -d / 2), (w / 2, -d / 2 + rim)),
        ((-w / 2, d / 2 - rim), (w / 2, d / 2)),
        ((-w / 2, -d / 2 + rim), (-w / 2 + rim, d / 2 - rim)),
        ((w / 2 - rim, -d / 2 + rim), (w / 2, d / 2 - rim)),
    ):
        m.box((*low, 0.3 * h), (*high, h), _CERAMIC)


def _bookshelf(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    wood = _pick("wood", _WOODS, rng)
    m.box((-w / 2, d / 2 - 0.02, 0), (w / 2, d / 2, h), wood)
    for x in (-w / 2, w / 2 - 0.03):
        m.box((x, -d / 2, 0), (x + 0.03, d / 2 - 0.02, h), wood)
    shelves = max(2, round(h / 0.38))
    for i in range(shelves + 1):
        z = i * (h - 0.03) / shelves
        m.box((-w / 2 + 0.03, -d / 2, z), (w / 2 - 0.03, d / 2 - 0.02, z + 0.03), wood)
        x = -w / 2 + 0.05
        while i < shelves and x < w / 2 - 0.12:
            wide, tall = float(rng.uniform(0.02, 0.05)), float(rng.uniform(0.55, 0.85)) * h / shelves
            m.box((x, -d / 2 + 0.06, z + 0.03), (x + wide, d / 2 - 0.03, z + tall), _pick("book", _FABRICS, rng))
            x += wide + (0.15 if rng.random() < 0.1 else 0.002)


def _lamp(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    del rng
    r = min(w, d) / 2
    prism(m, 0, 0, 0.7 * r, 0.7 * r, 0, 0.03, _METAL)
    prism(m, 0, 0, 0.015, 0.015, 0.03, 0.75 * h, _METAL, sides=6)
    prism(m, 0, 0, r, 0.65 * r, 0.75 * h, h, _LINEN)


def _box(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    wood = _pick("wood", _WOODS, rng)
    m.box((-w / 2, -d / 2, 0), (w / 2, d / 2, h), wood)


def _rug(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    m.box((-w / 2, -d / 2, 0), (w / 2, d / 2, max(h, 0.005)), _pick("fabric", _FABRICS, rng))


def _stairs(m: MeshBuilder, w: float, d: float, h: float, rng: np.random.Generator) -> None:
    """A straight flight that climbs to the back; of a height like Sweet Home 3D's, 1 m is its rail on the right."""
    del rng
    steps, rail = 12, 1.0 if h > 2.9 else 0.0
    rise = (h - rail) / steps
    for i in range(steps):
        y, top = -d / 2 + i * d / steps, (i + 1) * rise
        m.box((-w / 2, y, max(0.0, (i - 1) * rise)), (w / 2, y + d / steps, top), _STAIR_WOOD)
        if rail:
            m.box((w / 2 - 0.04, y, top), (w / 2, y + 0.04, top + rail), _STAIR_WOOD)


_MAKERS: dict[str, _Maker] = {
    "bed": _bed,
    "couch": _couch,
    "chair": _chair,
    "toilet": _toilet,
    "tv": _tv,
    "potted plant": _plant,
    "dining table": _table,
    "sink": _sink,
    "refrigerator": _refrigerator,
    "oven": _oven,
    "bathtub": _bathtub,
    "bookshelf": _bookshelf,
    "lamp": _lamp,
    "cabinet": _box,
    "rug": _rug,
    "stairs": _stairs,
}


def parametric_piece(kind: str, size_m: tuple[float, float, float] | None, rng: np.random.Generator) -> Mesh:
    """A piece of a kind (one of ``SIZES_M``; anything else becomes a box) in its local frame.

    Args:
        kind: the class, e.g. "bed".
        size_m: width, depth, height; None takes the usual one.
        rng: chooses colours and small things.
    """
    w, d, h = size_m if size_m is not None else SIZES_M.get(kind, (0.6, 0.4, 0.8))
    mesh = MeshBuilder()
    _MAKERS.get(kind, _box)(mesh, w, d, h, rng)
    return mesh.mesh()


def stair_flight(width_m: float, run_m: float, rise_m: float, steps: int) -> Mesh:
    """A straight flight that climbs towards +x, from x = 0, centred in y, closed below."""
    mesh = MeshBuilder()
    for i in range(steps):
        low = max(0.0, (i - 1) * rise_m / steps)
        mesh.box(
            (i * run_m / steps, -width_m / 2, low),
            ((i + 1) * run_m / steps, width_m / 2, (i + 1) * rise_m / steps),
            _STAIR_WOOD,
        )
    return mesh.mesh()
