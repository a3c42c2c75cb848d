"""What stands in a room: drawn from what stands in the rooms of the train homes (``data/room_statistics.json``).

The train homes have no offices. An office's rooms start from the type that they are most like, and ``data/assumed_rooms.json``
says what they lack and have besides: a desk and a chair for every 7 to 9 m², a table and chairs to meet at.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from typing import NamedTuple

import msgspec
import numpy as np

Size = tuple[float, float, float]


class Share(msgspec.Struct, frozen=True):
    """``share`` of the rooms have a kind of piece, each about ``size_m``; those have ``count`` of it on average, or one for
    every ``m2_each`` [m²] where that is above 0."""

    share: float
    size_m: Size
    count: float = 1.0
    m2_each: float = 0.0


class RoomStatistics(msgspec.Struct, frozen=True):
    """A type of room in the train homes. ``area_m2``: its "min", "mean" and "max"."""

    rooms: int
    area_m2: dict[str, float]
    pieces: dict[str, Share]


class AssumedRoom(msgspec.Struct, frozen=True):
    """A type of room that no train home has: which type it is ``like``, what it lacks of that, and what it has besides."""

    like: str
    without: list[str]
    more: dict[str, Share]


class Wanted(NamedTuple):
    """A piece that a room should have."""

    kind: str
    size_m: Size


class _Measured(msgspec.Struct):
    rooms: dict[str, RoomStatistics]


class _Assumed(msgspec.Struct):
    rooms: dict[str, AssumedRoom]


def _data(name: str) -> bytes:
    return resources.files("surveilnav.simulator.procedural").joinpath(f"data/{name}.json").read_bytes()


@lru_cache(maxsize=1)
def room_statistics() -> dict[str, RoomStatistics]:
    return msgspec.json.decode(_data("room_statistics"), type=_Measured).rooms


@lru_cache(maxsize=1)
def assumed_rooms() -> dict[str, AssumedRoom]:
    return msgspec.json.decode(_data("assumed_rooms"), type=_Assumed).rooms


def draw(type_: str, area_m2: float, rng: np.random.Generator) -> list[Wanted]:
    """What a room of that type and area should have.

    A kind is there with its share; how many there are grows with the area, within a factor of 1.6 of the homes' rooms.
    """
    room = assumed_rooms().get(type_) or AssumedRoom(type_, [], {})
    wanted: list[Wanted] = []
    if room.like:
        like = room_statistics()[room.like]
        growth = float(np.clip(area_m2 / like.area_m2["mean"], 0.5, 1.6))
        table = rng.random()  # chairs come with tables
        for kind, piece in like.pieces.items():
            chance = table if kind in ("table", "chair") else rng.random()
            if kind not in room.without and kind not in room.more and chance < piece.share:
                wanted += [_sized(kind, piece.size_m, rng)] * _number(piece.count, growth, rng)
    for kind, piece in room.more.items():
        if rng.random() < piece.share:
            count = max(1, int(area_m2 / piece.m2_each)) if piece.m2_each else _number(piece.count, 1.0, rng)
            wanted += [_sized(kind, piece.size_m, rng)] * count
    return _sensible(type_, wanted, rng)


def _number(mean: float, growth: float, rng: np.random.Generator) -> int:
    """At least one; what no room of the homes has twice comes once however large the room."""
    return 1 if mean <= 1.0 else 1 + int(rng.poisson(max(0.0, mean * growth - 1.0)))


def _sized(kind: str, size_m: Size, rng: np.random.Generator) -> Wanted:
    w, d, h = (round(v * float(rng.uniform(0.95, 1.05)), 2) for v in size_m)
    return Wanted(kind, (w, d, h))


_BEDS = ("double bed", "single bed", "bunk bed")


def _sensible(type_: str, wanted: list[Wanted], rng: np.random.Generator) -> list[Wanted]:
    """Corrects absurd combinations, which come about because each kind is drawn by itself: two sorts of bed, or none."""
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
