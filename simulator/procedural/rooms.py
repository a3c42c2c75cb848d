"""Which rooms lie along a corridor, and which doors lead to them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from surveilnav.simulator.procedural.floor_plan import FloorPlan
from surveilnav.simulator.procedural.layout import Body, Rect, Strip, snap

#: Types of office rooms: least and largest width along the corridor [m].
_OFFICE_WIDTHS: dict[str, tuple[float, float]] = {
    "office": (2.8, 4.6),
    "open office": (6.0, 8.5),
    "meeting": (4.0, 5.6),
    "kitchenette": (2.8, 3.6),
    "lounge": (4.2, 5.6),
    "toilets": (2.7, 3.2),
    "storage": (1.6, 2.4),
    "first aid": (2.7, 3.2),
}
_TITLES = {
    "office": "Office",
    "open office": "Open office",
    "meeting": "Meeting room",
    "kitchenette": "Kitchenette",
    "lounge": "Lounge",
    "storage": "Storage",
    "first aid": "First aid room",
}
#: A strip shorter than this can't hold a flat [m].
_MIN_FLAT_M = 5.4


def start(body: Body, rng: np.random.Generator) -> FloorPlan:
    """A floor with its corridor, stair hall and what lies behind that."""
    floor = FloorPlan(ways=body.corridors)
    stairs = () if body.stair_hall is None else (body.stair_hall.rect,)
    floor.add("Corridor", "corridor", *body.corridors, *stairs)
    for rect in body.common:
        room = floor.add("Laundry", "laundry", rect)
        floor.connect(0, room, rng, sides=stairs)
    return floor


def office_floor(body: Body, number: int, rng: np.random.Generator) -> FloorPlan:
    """Offices, meeting rooms, a kitchenette or lounge and toilets along the corridors."""
    floor = start(body, rng)
    strips = list(body.strips)
    wanted = ["toilets", "kitchenette" if rng.random() < 0.6 else "lounge", "meeting"]
    wanted += [
        w
        for w, share in (("lounge", 0.4), ("meeting", 0.5), ("storage", 0.6), ("first aid", 0.15))
        if rng.random() < share
    ]
    for index in rng.permutation(len(strips)):
        strip = strips[int(index)]
        for type_, s0, s1 in _fill(strip.length, wanted, rng):
            _office_room(floor, strip.part(s0, s1), type_, number, rng)
    return floor


def _fill(length: float, wanted: list[str], rng: np.random.Generator) -> list[tuple[str, float, float]]:
    """Rooms from end to end of a strip: what is wanted first, then offices; in any order."""
    chosen: list[tuple[str, float]] = []
    left = length
    while left > 0.01:
        type_ = next((w for w in wanted if _OFFICE_WIDTHS[w][0] <= left), "")
        if type_ and rng.random() < 0.75:
            wanted.remove(type_)
        else:
            type_ = "open office" if left > 9.0 and rng.random() < 0.3 else "office"
        low, high = _OFFICE_WIDTHS[type_]
        width = min(left, snap(rng.uniform(low, high)))
        if width < 2.4:
            type_ = "storage"
        if left - width < 1.6:
            width = left
        chosen.append((type_, width))
        left = round(left - width, 2)
    order = rng.permutation(len(chosen))
    rooms, at = [], 0.0
    for i in order:
        type_, width = chosen[int(i)]
        rooms.append((type_, at, round(at + width, 2)))
        at = round(at + width, 2)
    return rooms


def _office_room(floor: FloorPlan, strip: Strip, type_: str, number: int, rng: np.random.Generator) -> None:
    if type_ == "toilets":
        _toilets(floor, strip, number, rng)
        return
    count = sum(s.type == type_ for s in floor.spaces) + 1
    room = floor.add(f"{_TITLES[type_]} {number}.{count}", type_, strip.cell(0.0, strip.length))
    wide = type_ in ("lounge", "open office") and rng.random() < 0.5
    if not (wide and floor.connect(0, room, rng, "frame", 1.4)):
        floor.connect(0, room, rng)
    if type_ == "open office":
        floor.connect(0, room, rng)


def _toilets(floor: FloorPlan, strip: Strip, number: int, rng: np.random.Generator) -> None:
    """A washroom at the corridor, two toilets behind it."""
    front, middle = snap(min(2.0, strip.depth / 2)), snap(strip.length / 2)
    count = sum(s.type == "washroom" for s in floor.spaces)
    washroom = floor.add(f"Toilet washroom {number}.{count + 1}", "washroom", strip.cell(0.0, strip.length, 0.0, front))
    floor.connect(0, washroom, rng)
    for i, (s0, s1) in enumerate(((0.0, middle), (middle, strip.length))):
        room = floor.add(f"Toilet {number}.{2 * count + i + 1}", "toilet", strip.cell(s0, s1, front))
        floor.connect(washroom, room, rng)


def flats_floor(body: Body, number: int, rng: np.random.Generator) -> FloorPlan:
    """Flats along the corridor; what is too short for one becomes a storage room."""
    floor = start(body, rng)
    flat = 0
    for strip in body.strips:
        if strip.length < _MIN_FLAT_M:
            count = sum(s.type == "storage" for s in floor.spaces) + 1
            room = floor.add(f"Storage {number}.{count}", "storage", strip.cell(0.0, strip.length))
            floor.connect(0, room, rng)
            continue
        count = max(1, round(strip.length / rng.uniform(7.5, 10.0)))
        while strip.length / count < _MIN_FLAT_M:
            count -= 1
        cuts = [
            snap(strip.length * i / count + (rng.uniform(-0.5, 0.5) if 0 < i < count else 0.0))
            for i in range(count + 1)
        ]
        cuts[-1] = strip.length
        for s0, s1 in pairwise(cuts):
            flat += 1
            _flat(floor, strip.part(s0, s1), f"Flat {number}.{flat}", rng)
    return floor


def _flat(floor: FloorPlan, strip: Strip, title: str, rng: np.random.Generator) -> None:
    """A row of small rooms at the corridor, a hall behind it, and the rooms with windows at the facade."""
    flip, length = rng.random() < 0.5, strip.length
    row = snap(rng.uniform(1.9, 2.2))
    hall_end = snap(row + rng.uniform(1.2, 1.35))

    def cell(s0: float, s1: float, t0: float, t1: float | None) -> Rect:
        return strip.cell(length - s1, length - s0, t0, t1) if flip else strip.cell(s0, s1, t0, t1)

    small, entrance = _small_rooms(length, rng)
    hall = floor.add(f"{title} hall", "hall", cell(0.0, length, row, hall_end), cell(*entrance, 0.0, row))
    floor.connect(0, hall, rng)
    rooms = [(floor.add(f"{title} {type_}", type_, cell(s0, s1, 0.0, row)), type_) for type_, s0, s1 in small]
    has_kitchen = any(type_ == "kitchen" for type_, *_ in small)
    at, bedrooms, before = 0.0, 0, (-1, "")
    for type_, width in _facade_rooms(length, has_kitchen, rng):
        bedrooms += type_ == "bedroom"
        name = {"living": "living room", "bedroom": f"bedroom {bedrooms}"}.get(type_, type_)
        end = length if at + width > length - 0.3 else round(at + width, 2)
        rooms.append((floor.add(f"{title} {name}", type_, cell(at, end, hall_end, None)), type_))
        if {type_, before[1]} == {"living", "kitchen"} and rng.random() < 0.4:
            floor.connect(before[0], rooms[-1][0], rng, "frame", 1.2)
        before, at = rooms[-1], end
    for room, type_ in rooms:
        wide = type_ == "living" and rng.random() < 0.4
        if not (wide and floor.connect(hall, room, rng, "frame", 1.3)):
            floor.connect(hall, room, rng)


def _small_rooms(length: float, rng: np.random.Generator) -> tuple[list[tuple[str, float, float]], tuple[float, float]]:
    """The row at the corridor: (type, from, to) of its rooms, and where the way in lies between them."""
    way = snap(rng.uniform(1.3, 1.5))
    bath = snap(min(rng.uniform(2.2, 2.7), length - way - 2.0))
    rest = round(length - bath - way, 2)
    if length < 8.2:  # a small flat: the kitchen has no window
        return [("bath", 0.0, bath), ("kitchen", round(bath + way, 2), length)], (bath, round(bath + way, 2))
    toilet = snap(rng.uniform(1.2, 1.4))
    rest = round(rest - toilet, 2)
    at = round(bath + way, 2)
    rooms = [("bath", 0.0, bath), ("toilet", at, round(at + toilet, 2))]
    if rest > 4.0:
        middle = snap(at + toilet + rest / 2)
        rooms += [("storage", round(at + toilet, 2), middle), ("study", middle, length)]
    elif rest >= 1.3:
        rooms.append(("storage", round(at + toilet, 2), length))
    else:
        rooms[-1] = ("toilet", at, length)
    return rooms, (bath, at)


def _facade_rooms(length: float, has_kitchen: bool, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Rooms with windows from end to end: (type, width); the last takes what is left."""
    spare = 2.6 if has_kitchen else 5.5
    living = snap(min(rng.uniform(3.6, 5.4), max(2.8 if has_kitchen else 3.0, length - spare)))
    rooms = [("living", living)]
    if not has_kitchen:
        rooms.append(("kitchen", snap(min(rng.uniform(2.3, 2.9), length - living - 2.5))))
    left = length - sum(width for _, width in rooms)
    while left > 2.4:
        type_ = "study" if rooms[-1][0] == "bedroom" and rng.random() < 0.25 else "bedroom"
        width = snap(rng.uniform(2.7, 3.6))
        if left - width < 2.4:
            width = left
        rooms.append((type_, width))
        left -= width
    rooms[-1] = (rooms[-1][0], length)
    if rng.random() < 0.5:  # bedrooms first, or the living room first
        last = rooms.pop()
        used = sum(width for _, width in rooms)
        rooms = [(last[0], snap(length - used)), *rooms[::-1]]
    return rooms
