"""What stands in the rooms of the train homes: writes ``data/room_statistics.json``.

``python -m surveilnav.simulator.procedural.measure`` prints the table; ``> room_statistics.json`` keeps it.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable

import numpy as np

from surveilnav.config import cache_dir
from surveilnav.simulator.furniture.assets import ensure_assets
from surveilnav.simulator.furniture.catalog import Furniture
from surveilnav.simulator.furniture.placing import kind_of
from surveilnav.simulator.plans.polygons import contains, signed_area
from surveilnav.simulator.plans.sweethome import Home, Piece, PlanRoom
from surveilnav.simulator.sources import TRAIN_HOMES, read_example

COMMAND = "python -m surveilnav.simulator.procedural.measure"

#: Types by a room's name, then by what stands in it.
_BY_NAME = (
    (r"terrace|balcony|garage|roof", ""),
    (r"living", "living"),
    (r"dining", "dining"),
    (r"kitchen", "kitchen"),
    (r"bedro", "bedroom"),
    (r"bath", "bath"),
    (r"hall|corridor|entrance", "hall"),
    (r"office|study", "study"),
    (r"dressing|storage|cellar", "storage"),
)
_BY_CONTENT = (
    ("bath", "bath"),
    ("shower", "bath"),
    ("toilet", "toilet"),
    ("double bed", "bedroom"),
    ("sofa", "living"),
    ("bookcase", "storage"),
    ("washing machine", "laundry"),
)
#: Catalogue entries that are never swapped, and what we call them.
_OTHERS = {
    "eTeks#kitchenCabinet": "kitchen cabinet",
    "eTeks#kitchenUpperCabinet": "upper cabinet",
    "eTeks#dishwasher": "dishwasher",
    "eTeks#fittedBath": "bath",
    "eTeks#bath": "bath",
    "eTeks#shower": "shower",
    "eTeks#floorUplight": "floor lamp",
    "eTeks#stool": "stool",
    "eTeks#cornerBunkBed90x190": "bunk bed",
    "eTeks#loftBed140x190": "bunk bed",
}
_SAME = {"corner sofa": "sofa", "round table": "table", "flowers": "plant", "small plant": "plant"}
_LOW_TABLES = ("eTeks#squareTable", "eTeks#roundTable", "eTeks#bedsideTable")
#: A plant that stands higher than this stands on something [m].
_ON_TOP_M = 0.3


def kind_in_plan(piece: Piece) -> str:
    """What the statistics call a piece; "" for what they leave out (lamps, radiators, boxes)."""
    kind = kind_of(piece.catalog_id, piece.size_m)
    name = _OTHERS.get(piece.catalog_id, "") if kind is None else _SAME.get(kind.name, kind.name)
    if not name and piece.catalog_id in _LOW_TABLES and max(piece.size_m[:2]) >= 0.6 and piece.size_m[2] < 0.65:
        return "low table"
    return "plant on top" if name == "plant" and piece.z_m > _ON_TOP_M else name


def measure(homes: Iterable[Home]) -> dict[str, dict]:
    """Per type of room: how many there are, their area, and per kind of piece the share of rooms that have one, how
    many those have, and the middle size."""
    areas: dict[str, list[float]] = defaultdict(list)
    counts: dict[str, list[Counter[str]]] = defaultdict(list)
    sizes: dict[tuple[str, str], list[tuple[float, float, float]]] = defaultdict(list)
    for home in homes:
        for room, pieces in _contents(home):
            kinds = Counter(kind for p in pieces if (kind := kind_in_plan(p)))
            type_ = _type_of(room, kinds)
            if not type_:
                continue
            areas[type_].append(_area(room))
            counts[type_].append(kinds)
            for p in pieces:
                sizes[type_, kind_in_plan(p)].append(p.size_m)
    table: dict[str, dict] = {}
    for type_ in sorted(areas):
        rooms = counts[type_]
        table[type_] = {
            "rooms": len(rooms),
            "area_m2": {name: round(float(value), 1) for name, value in _spread(areas[type_]).items()},
            "pieces": {
                kind: {
                    "share": round(sum(kind in c for c in rooms) / len(rooms), 2),
                    "count": round(sum(c[kind] for c in rooms) / sum(kind in c for c in rooms), 2),
                    "size_m": [round(float(v), 2) for v in np.median(sizes[type_, kind], axis=0)],
                }
                for kind in sorted({k for c in rooms for k in c})
            },
        }
    return table


def _spread(values: list[float]) -> dict[str, float]:
    return {"min": min(values), "mean": float(np.mean(values)), "max": max(values)}


def _area(room: PlanRoom) -> float:
    return abs(float(signed_area(np.array(room.outline_m))))


def _contents(home: Home) -> list[tuple[PlanRoom, list[Piece]]]:
    """Each room with what stands in it; where outlines overlap a piece belongs to the smallest."""
    rooms = sorted((r for r in home.rooms if len(r.outline_m) >= 3), key=_area)
    found: list[tuple[PlanRoom, list[Piece]]] = [(room, []) for room in rooms]
    for piece in home.pieces:
        if piece.is_opening or piece.stair_cut:
            continue
        p = np.array([piece.x_m, piece.y_m])
        for room, pieces in found:
            if room.level == piece.level and contains(np.array(room.outline_m), p):
                pieces.append(piece)
                break
    return found


def _type_of(room: PlanRoom, kinds: Counter[str]) -> str:
    """The type of a room; "" for what is outdoors and for rooms without a name or anything telling."""
    for pattern, type_ in _BY_NAME:
        if re.search(pattern, room.name, re.IGNORECASE):
            return type_
    return next((type_ for kind, type_ in _BY_CONTENT if kinds[kind]), "")


def main() -> int:
    """Prints the table."""
    with Furniture(ensure_assets(), cache_dir()) as furniture:
        rooms = measure(read_example(name, furniture) for name in TRAIN_HOMES)
    about = (
        "What stands in the rooms of the train homes, by type of room: the share of rooms with at least one piece of "
        f"a kind, the mean count in those, the middle width, depth, height [m]. Made by `{COMMAND}`."
    )
    sys.stdout.write(
        '{\n "about": ' + json.dumps(about) + ',\n "homes": ' + json.dumps(TRAIN_HOMES) + ',\n "rooms": {\n'
    )
    for i, (type_, row) in enumerate(rooms.items()):
        pieces = ",\n".join(f"    {json.dumps(kind)}: {json.dumps(p)}" for kind, p in row["pieces"].items())
        sys.stdout.write(
            f'  {json.dumps(type_)}: {{"rooms": {row["rooms"]}, "area_m2": {json.dumps(row["area_m2"])}, '
            f'"pieces": {{\n{pieces}\n  }}}}' + (",\n" if i < len(rooms) - 1 else "\n")
        )
    sys.stdout.write(" }\n}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
