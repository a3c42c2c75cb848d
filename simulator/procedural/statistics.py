"""What stands in a room: drawn from what stands in the rooms of the train homes (``data/room_statistics.json``).

The train homes have no offices. Their rooms start from the nearest type and add what ``_ASSUMED`` says: a desk and a
chair for every 7 to 9 m2, a table and chairs to meet at, a bed in the first aid room.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np

Size = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Share:
    """``share`` of the rooms have a kind; those have ``count`` of it on average, each about ``size_m``."""

    share: float
    count: float
    size_m: Size


@dataclass(frozen=True, slots=True)
class RoomStatistics:
    """A type of room in the train homes."""

    mean_area_m2: float
    pieces: dict[str, Share]


@dataclass(frozen=True, slots=True)
class Wanted:
    """A piece that a room should have."""

    kind: str
    size_m: Size


_DESK, _OFFICE_CHAIR = (1.5, 0.75, 0.75), (0.62, 0.62, 0.95)
_PLANT, _TV = (0.5, 0.45, 1.03), (1.21, 0.2, 0.75)
_CHAIR: Size = (0.42, 0.45, 0.9)

#: Types that no train home has: the type that they start from, what they don't have of it, and what they have besides
#: (share of rooms, number of pieces, or m2 per piece where negative, size).
_ASSUMED: dict[str, tuple[str, tuple[str, ...], dict[str, tuple[float, float, Size]]]] = {
    "office": (
        "study",
        ("table", "chair", "sofa", "low table", "bookcase", "floor lamp"),
        {
            "desk": (1.0, -9.0, _DESK),
            "office chair": (1.0, -9.0, _OFFICE_CHAIR),
            "bookcase": (0.7, 1.5, (1.02, 0.4, 2.11)),
            "chair": (0.3, 1.5, _CHAIR),
            "sofa": (0.08, 1.0, (1.7, 0.85, 0.87)),
            "plant": (0.25, 1.2, _PLANT),
            "plant on top": (0.15, 1.0, (0.24, 0.22, 0.49)),
            "tv": (0.04, 1.0, _TV),
        },
    ),
    "open office": (
        "study",
        ("table", "chair", "sofa", "low table", "bookcase", "floor lamp"),
        {
            "desk": (1.0, -7.0, _DESK),
            "office chair": (1.0, -7.0, _OFFICE_CHAIR),
            "bookcase": (0.8, 2.0, (1.02, 0.4, 2.11)),
            "plant": (0.5, 1.5, _PLANT),
            "tv": (0.1, 1.0, _TV),
        },
    ),
    "meeting": (
        "",
        (),
        {
            "table": (1.0, 1.0, (2.2, 1.0, 0.74)),
            "chair": (1.0, 7.0, _CHAIR),
            "tv": (0.5, 1.0, _TV),
            "plant": (0.3, 1.2, _PLANT),
            "chest": (0.4, 1.0, (1.2, 0.5, 0.8)),
        },
    ),
    "lounge": ("living", ("piano", "bookcase"), {}),
    "kitchenette": ("kitchen", ("washing machine", "wardrobe"), {}),
    "washroom": ("", (), {"washbasin": (1.0, 2.0, (0.56, 0.47, 0.97))}),
    "first aid": (
        "",
        (),
        {
            "single bed": (1.0, 1.0, (0.95, 2.0, 0.7)),
            "chair": (0.8, 1.0, _CHAIR),
            "washbasin": (1.0, 1.0, (0.56, 0.47, 0.97)),
            "wardrobe": (0.5, 1.0, (0.9, 0.5, 1.7)),
        },
    ),
    "corridor": ("hall", (), {"plant": (0.35, 1.5, _PLANT), "chair": (0.15, 2.0, _CHAIR)}),
}


@lru_cache(maxsize=1)
def room_statistics() -> dict[str, RoomStatistics]:
    """The table by type of room."""
    text = resources.files("surveilnav.simulator.procedural").joinpath("data/room_statistics.json").read_text("utf-8")
    return {
        type_: RoomStatistics(
            row["area_m2"]["mean"],
            {
                k: Share(p["share"], p["count"], (p["size_m"][0], p["size_m"][1], p["size_m"][2]))
                for k, p in row["pieces"].items()
            },
        )
        for type_, row in json.loads(text)["rooms"].items()
    }


def draw(type_: str, area_m2: float, rng: np.random.Generator) -> list[Wanted]:
    """What a room of that type and area should have.

    A kind is there with its share; how many there are grows with the area, within a factor of 1.6 of the homes' rooms.
    """
    base, without, more = _ASSUMED.get(type_, (type_, (), {}))
    wanted: list[Wanted] = []
    if base:
        rooms = room_statistics()[base]
        growth = float(np.clip(area_m2 / rooms.mean_area_m2, 0.5, 1.6))
        table = rng.random()  # chairs come with tables
        for kind, share in rooms.pieces.items():
            chance = table if kind in ("table", "chair") else rng.random()
            if kind not in without and kind not in more and chance < share.share:
                wanted += [_sized(kind, share.size_m, rng)] * _number(share.count, growth, rng)
    for kind, (share_of_rooms, number, size) in more.items():
        if rng.random() < share_of_rooms:
            count = max(1, int(area_m2 / -number)) if number < 0 else _number(number, 1.0, rng)
            wanted += [_sized(kind, size, rng)] * count
    return _sensible(type_, wanted, rng)


def _number(mean: float, growth: float, rng: np.random.Generator) -> int:
    """At least one; what no room of the homes has twice comes once however large the room."""
    return 1 if mean <= 1.0 else 1 + int(rng.poisson(max(0.0, mean * growth - 1.0)))


def _sized(kind: str, size_m: Size, rng: np.random.Generator) -> Wanted:
    w, d, h = (round(v * float(rng.uniform(0.95, 1.05)), 2) for v in size_m)
    return Wanted(kind, (w, d, h))


_BEDS = ("double bed", "single bed", "bunk bed")


def _sensible(type_: str, wanted: list[Wanted], rng: np.random.Generator) -> list[Wanted]:
    """Shares are drawn one by one: put right what that makes absurd (two sorts of bed, no bed, two baths in a row)."""
    if type_ == "bedroom":
        table = room_statistics()["bedroom"].pieces
        weights = np.array([table[b].share for b in _BEDS])
        bed = _BEDS[int(rng.choice(3, p=weights / weights.sum()))]
        count = 2 if bed == "single bed" and rng.random() < table[bed].count - 1 else 1
        wanted = [w for w in wanted if w.kind not in _BEDS] + [_sized(bed, table[bed].size_m, rng)] * count
        if bed != "double bed":
            beside = [w for w in wanted if w.kind == "bedside table"]
            wanted = [w for w in wanted if w.kind != "bedside table"] + beside[:1]
    kinds = [w.kind for w in wanted]
    if type_ == "bath" and "bath" in kinds and "shower" in kinds:
        wanted = [w for w in wanted if w.kind != "shower"]
    if type_ == "bath" and "vanity" in kinds:
        wanted = [w for w in wanted if w.kind != "washbasin"]
    if "tv" in kinds and "tv on a stand" in kinds:
        wanted = [w for w in wanted if w.kind != "tv on a stand"]
    most = {"sofa": 3, "bookcase": 3 if type_ == "study" else 8, "vanity": 2}
    kept: list[Wanted] = []
    for w in wanted:
        if sum(k.kind == w.kind for k in kept) < most.get(w.kind, 8):
            kept.append(w)
    return kept
