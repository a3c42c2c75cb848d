"""Puts what a room should have into it: against walls, around tables, in corners, on top of other pieces."""

from __future__ import annotations

import numpy as np

from surveilnav.simulator.procedural.pieces import PIECES
from surveilnav.simulator.procedural.space import FRONTS, Placed, RoomSpace
from surveilnav.simulator.procedural.statistics import Size, Wanted

_ORDER = list(PIECES)
#: What a small thing may stand on, the best first.
_TOPS = ("chest", "low table", "bedside table", "table", "desk", "kitchen cabinet", "vanity")
_KITCHEN = ("refrigerator", "kitchen sink", "oven", "dishwasher", "kitchen cabinet")
#: Where a table is to work at, not to dine at.
_DESK_ROOMS = ("bedroom", "study", "office", "open office")
_GAP_M = 0.03


def furnish(space: RoomSpace, type_: str, wanted: list[Wanted], rng: np.random.Generator) -> None:
    """Places as many of the ``wanted`` pieces as fit; adds them to ``space.pieces``."""
    todo = sorted(wanted, key=lambda w: _ORDER.index(w.kind))
    if any(w.kind in _KITCHEN for w in todo) and type_ in ("kitchen", "kitchenette"):
        todo = _kitchen_run(space, todo, rng)
    chairs = [w for w in todo if w.kind == "chair"]
    for want in todo:
        if want.kind == "table" and type_ not in _DESK_ROOMS:
            _table_with_chairs(space, want.size_m, chairs, rng)
        elif want.kind in ("desk", "table"):
            _desk(space, want, todo, chairs, rng)
        elif want.kind in ("plant on top", "tv"):
            _on_top(space, want, rng)
        elif want.kind == "bedside table":
            _beside_bed(space, want.size_m, rng)
        elif want.kind == "low table":
            _before_sofa(space, want.size_m, rng)
        elif want.kind == "upper cabinet":
            _above(space, want.size_m)
        elif want.kind != "office chair" and (want.kind != "chair" or want in chairs):
            if want.kind == "chair":
                chairs.remove(want)
                if sum(p.kind == "chair" for p in space.pieces) and rng.random() < 0.5:
                    continue  # chairs that found no place at a table don't all line the walls
            facing = next((p for p in space.pieces if p.kind == "sofa"), None) if want.kind == "tv on a stand" else None
            space.at_wall(
                want.kind,
                want.size_m,
                rng,
                front_m=PIECES[want.kind].front_m,
                corner=PIECES[want.kind].in_corner,
                facing=facing,
            )


def _local(piece: Placed, right: float, front: float) -> tuple[float, float]:
    """A point to the right and before a piece's middle, as it looks, in the room."""
    fx, fy = FRONTS[piece.quarter]
    # Looking towards -y the piece's right hand (x of its own frame) is +x.
    return round(piece.x - fy * right + fx * front, 3), round(piece.y + fx * right + fy * front, 3)


def _put(space: RoomSpace, piece: Placed) -> bool:
    return space.fits(piece) and space.add(piece)


def _kitchen_run(space: RoomSpace, todo: list[Wanted], rng: np.random.Generator) -> list[Wanted]:
    """Refrigerator, sink, oven, dishwasher and cabinets side by side along walls; returns what is left to do."""
    run = [w for w in todo if w.kind in _KITCHEN]
    rest = [w for w in todo if w.kind not in _KITCHEN]
    line: list[Wanted] = [w for w in run if w.kind != "kitchen cabinet"][:4]
    spare = [w for w in run if w.kind == "kitchen cabinet"]
    for at in (1, 3):  # a cabinet between refrigerator and sink, one beside the oven
        if spare:
            line.insert(min(at, len(line)), spare.pop())
    line += spare
    while line:
        # As much of the line as one wall takes; the rest goes to the next wall.
        for count in range(len(line), 0, -1):
            if _row(space, line[:count], rng):
                line = line[count:]
                break
        else:
            line = line[1:]
    return rest


def _row(space: RoomSpace, line: list[Wanted], rng: np.random.Generator) -> bool:
    """Places pieces side by side, their backs in one line."""
    width, depth = sum(w.size_m[0] for w in line), max(w.size_m[1] for w in line)
    tall = max(w.size_m[2] for w in line)
    before = list(space.pieces)
    whole = space.at_wall("row", (width, depth, min(tall, 0.9)), rng, front_m=0.75, corner=True, tries=3)
    if whole is None:
        return False
    space.pieces = before
    flip = 1.0 if rng.random() < 0.5 else -1.0
    at, placed = -width / 2, []
    for want in line:
        w, d, _ = want.size_m
        x, y = _local(whole, flip * (at + w / 2), (d - depth) / 2)
        piece = Placed(want.kind, x, y, whole.quarter, want.size_m)
        if space.fits(piece):
            placed.append(piece)
            space.pieces.append(piece)
        at += w
    return bool(placed)


def _above(space: RoomSpace, size_m: Size) -> None:
    """An upper cabinet above the next lower one that has none, its back on the same wall."""
    w, d, h = size_m
    for low in [p for p in space.pieces if p.kind in ("kitchen cabinet", "kitchen sink", "dishwasher", "vanity")]:
        width = min(w, low.size_m[0])
        x, y = _local(low, 0.0, -(low.size_m[1] - d) / 2)
        piece = Placed("upper cabinet", x, y, low.quarter, (width, d, h), 1.45)
        if space.fits(piece):
            space.add(piece)
            return


def _table_with_chairs(space: RoomSpace, size_m: Size, chairs: list[Wanted], rng: np.random.Generator) -> None:
    """A table in the open, chairs along its sides; smaller where the room is small."""
    for shrink in (1.0, 0.85, 0.7):
        w, d, h = round(size_m[0] * shrink, 2), round(size_m[1] * shrink, 2), size_m[2]
        for quarter in [int(q) for q in rng.permutation(2)]:
            table = space.in_the_open("table", (w, d, h), quarter, rng)
            if table is not None:
                _chairs_around(space, table, chairs, rng)
                return
    table = space.at_wall("table", (round(size_m[0] * 0.7, 2), round(size_m[1] * 0.7, 2), size_m[2]), rng, front_m=0.6)
    if table is not None:
        _chairs_around(space, table, chairs, rng)


def _chairs_around(space: RoomSpace, table: Placed, chairs: list[Wanted], rng: np.random.Generator) -> None:
    w, d, _ = table.size_m
    seats: list[tuple[float, float, int]] = []
    per_side = max(1, int(w / 0.6))
    for i in range(per_side):
        along = w * ((i + 0.5) / per_side - 0.5)
        seats += [(along, 1.0, 0), (along, -1.0, 2)]
    ends = [(1.0, 0.0, 1), (-1.0, 0.0, 3)] if d >= 0.6 else []
    for right, front, turn in [*(seats[int(i)] for i in rng.permutation(len(seats))), *ends]:
        if not chairs:
            return
        depth = chairs[0].size_m[1]
        reach = depth / 2 + _GAP_M
        if turn in (0, 2):  # before and behind: they look at the table
            x, y = _local(table, right, front * (d / 2 + reach))
            quarter = (table.quarter + (2 if turn == 0 else 0)) % 4
        else:
            x, y = _local(table, right * (w / 2 + reach), 0.0)
            quarter = (table.quarter + (3 if turn == 1 else 1)) % 4
        if _put(space, Placed("chair", x, y, quarter, chairs[0].size_m)):
            chairs.pop(0)


def _desk(space: RoomSpace, want: Wanted, todo: list[Wanted], chairs: list[Wanted], rng: np.random.Generator) -> None:
    """A desk at a wall with a chair before it."""
    w, d, h = want.size_m
    w = min(w, 1.8)
    seat = next((c for c in todo if c.kind == "office chair"), None) or (chairs[0] if chairs else None)
    desk = space.at_wall(want.kind, (w, d, h), rng, front_m=0.85)
    if desk is None or seat is None:
        return
    x, y = _local(desk, 0.0, d / 2 + seat.size_m[1] / 2 + _GAP_M)
    if _put(space, Placed(seat.kind, x, y, (desk.quarter + 2) % 4, seat.size_m)) and seat.kind == "chair":
        chairs.remove(seat)


def _beside_bed(space: RoomSpace, size_m: Size, rng: np.random.Generator) -> None:
    for bed in [p for p in space.pieces if p.kind.endswith("bed")]:
        for side in (1.0, -1.0) if rng.random() < 0.5 else (-1.0, 1.0):
            x, y = _local(bed, side * (bed.size_m[0] / 2 + size_m[0] / 2 + _GAP_M), -(bed.size_m[1] - size_m[1]) / 2)
            if _put(space, Placed("bedside table", x, y, bed.quarter, size_m)):
                return
    space.at_wall("bedside table", size_m, rng, front_m=0.0)


def _before_sofa(space: RoomSpace, size_m: Size, rng: np.random.Generator) -> None:
    w, d, h = size_m
    for sofa in [p for p in space.pieces if p.kind == "sofa"]:
        x, y = _local(sofa, 0.0, sofa.size_m[1] / 2 + 0.4 + min(w, d) / 2)
        table = Placed("low table", x, y, sofa.quarter, (max(w, d), min(w, d), h))
        if _put(space, table):
            return
    space.at_wall("low table", size_m, rng, front_m=0.3)


def _on_top(space: RoomSpace, want: Wanted, rng: np.random.Generator) -> None:
    """On a chest or table with room for it; a television else hangs on the wall, opposite to the sofa if it can."""
    w, d, h = want.size_m
    kind = "plant" if want.kind == "plant on top" else want.kind
    for name in ("chest",) if kind == "tv" else _TOPS:
        for below in [p for p in space.pieces if p.kind == name]:
            bw, bd, bh = below.size_m
            if kind == "tv" and w > bw + 0.25:
                continue
            d = min(d, bd)
            aside = 0.0 if kind == "tv" else float(rng.uniform(-1, 1)) * max(0.0, bw / 2 - w)
            x, y = _local(below, aside, 0.0)
            if _put(space, Placed(kind, x, y, below.quarter, (w, d, h), round(below.z_m + bh, 3))):
                return
    if kind == "tv":
        sofa = next((p for p in space.pieces if p.kind == "sofa"), None)
        space.at_wall("tv", (w, min(d, 0.12), h), rng, front_m=0.0, z_m=1.05, facing=sofa)
