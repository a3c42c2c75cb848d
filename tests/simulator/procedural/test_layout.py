"""Generated plans: rooms, doors, walls and furniture on paper, over many numbers (no scene is built)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.simulator.plans.placing import seeded
from surveilnav.simulator.procedural.buildings import KINDS, flight_rect, furnished, generated_home, plan
from surveilnav.simulator.procedural.floor_plan import OUTSIDE, FloorPlan, Hole, shared_edge
from surveilnav.simulator.procedural.layout import Body, Rect
from surveilnav.simulator.procedural.space import Placed, RoomSpace
from surveilnav.simulator.procedural.statistics import draw, room_statistics
from surveilnav.simulator.procedural.walls import HALF_M, INNER_M, inset, raster_of
from surveilnav.simulator.world.polygons import signed_area

numbers = st.integers(0, 10**9)
kinds = st.sampled_from(sorted(KINDS))


def a_plan(kind: str, number: int) -> tuple[Body, list[FloorPlan]]:
    return plan(kind, seeded(f"plan|{kind}_{number}"))


def way(hole: Hole, reach_m: float) -> Rect:
    """The ground on both sides of a door."""
    half, deep = (hole.width_m / 2, reach_m) if hole.along_x else (reach_m, hole.width_m / 2)
    return Rect(hole.x - half, hole.y - deep, hole.x + half, hole.y + deep)


@given(kinds, numbers)
@settings(max_examples=25, deadline=None)
def test_rooms_tile_the_floor(kind: str, number: int) -> None:
    _, floors = a_plan(kind, number)
    for floor in floors:
        rects = [r for space in floor.spaces for r in space.rects]
        assert all(min(r.width, r.depth) > 0.9 for r in rects)
        assert not any(a.overlaps(b) for a, b in combinations(rects, 2))
        outline = np.array(raster_of(floor.spaces).outline(OUTSIDE))
        assert sum(r.area for r in rects) == pytest.approx(signed_area(outline), abs=0.01)


@given(kinds, numbers)
@settings(max_examples=25, deadline=None)
def test_every_room_is_reached_from_the_corridor(kind: str, number: int) -> None:
    body, floors = a_plan(kind, number)
    for level, floor in enumerate(floors):
        doors = [h for h in floor.holes if h.what in ("door", "frame")]
        reached = {0}
        for _ in floor.spaces:
            reached |= {room for h in doors if reached & set(h.rooms) for room in h.rooms}
        assert reached == set(range(len(floor.spaces)))
        assert not any(way(a, 0.05).overlaps(way(b, 0.05)) for a, b in combinations(doors, 2))
        for hole in doors:
            edges = [
                shared_edge(p, q) for p in floor.spaces[hole.rooms[0]].rects for q in floor.spaces[hole.rooms[1]].rects
            ]
            s, at = (hole.x, hole.y) if hole.along_x else (hole.y, hole.x)
            assert any(
                e is not None
                and e[0] == hole.along_x
                and abs(e[1] - at) < 1e-6
                and e[2] < s - hole.width_m / 2
                and s + hole.width_m / 2 < e[3]
                for e in edges
            )
            if 0 in hole.rooms:  # nobody falls out of a door into the stairs
                flights = [flight_rect(body, f) for f in (level - 1, level) if 0 <= f < len(floors) - 1]
                assert not any(way(hole, 0.8).overlaps(flight) for flight in flights)


@given(numbers)
@settings(max_examples=20, deadline=None)
def test_a_flat_has_what_people_need(number: int) -> None:
    body, floors = a_plan("flats", number)
    for floor in floors:
        names = [s.name for s in floor.spaces if s.name.startswith("Flat")]
        flats = {" ".join(name.split()[:2]) for name in names}
        assert flats
        for flat in flats:
            inside = {name.removeprefix(f"{flat} ") for name in names if name.startswith(f"{flat} ")}
            assert {"hall", "bath", "kitchen", "living room", "bedroom 1"} <= inside
            baths = [s for s in floor.spaces if s.name in (f"{flat} bath", f"{flat} toilet")]
            assert baths
    assert (body.stair_hall is not None) == (len(floors) > 1)


@given(kinds, numbers)
@settings(max_examples=15, deadline=None)
def test_walls_meet_without_overlapping(kind: str, number: int) -> None:
    _, floors = a_plan(kind, number)
    for floor in floors:
        raster = raster_of(floor.spaces)
        boxes = []
        for (x0, y0), (x1, y1) in raster.inner_walls():
            along_x = y0 == y1
            dx, dy = (0.0, HALF_M) if along_x else (HALF_M, 0.0)
            boxes.append(Rect(x0 - dx, y0 - dy, x1 + dx, y1 + dy))
            assert (x1 - x0 if along_x else y1 - y0) > INNER_M
        assert not any(a.overlaps(b, 1e-4) for a, b in combinations(boxes, 2))
        # With the rooms between them they cover the floor but for nothing.
        inner = sum(signed_area(np.array(inset(raster.outline(i), HALF_M))) for i in range(len(floor.spaces)))
        inside_m2 = signed_area(np.array(inset(raster.outline(OUTSIDE), HALF_M)))
        assert inner + sum(b.area for b in boxes) == pytest.approx(inside_m2, abs=0.02)


@given(kinds, numbers)
@settings(max_examples=10, deadline=None)
def test_furniture_stands_in_its_room_clear_of_doors_and_of_each_other(kind: str, number: int) -> None:
    body, floors = a_plan(kind, number)
    floor = floors[0]
    for room, space in zip(floor.spaces, furnished(body, floor, seeded(str(number))), strict=True):
        for piece in space.pieces:
            assert any(r.inset(HALF_M).contains(piece.footprint, 2e-3) for r in room.rects)
            assert piece.z_m >= 0
        for a, b in combinations(space.pieces, 2):
            apart = a.z_m >= b.z_m + b.size_m[2] - 1e-6 or b.z_m >= a.z_m + a.size_m[2] - 1e-6
            assert apart or not a.footprint.overlaps(b.footprint, 2e-3), (a, b)
        for hole in (h for h in floor.holes if floor.spaces.index(room) in h.rooms and "window" not in h.what):
            assert not any(way(hole, 0.7).overlaps(p.footprint) for p in space.pieces if p.z_m < 1.0)


def test_a_piece_that_would_part_the_room_is_refused() -> None:
    door = Hole("door", (0, 1), 0.6, 0.0, 0.95, 0)
    space = RoomSpace([Rect(0.0, 0.0, 3.0, 6.0)], [door])
    assert not space.add(Placed("wardrobe", 1.5, 3.0, 0, (2.8, 0.5, 2.0)))
    assert not space.add(Placed("wardrobe", 1.5, 1.2, 0, (2.8, 0.3, 2.0)))
    assert space.add(Placed("wardrobe", 1.5, 5.6, 0, (2.8, 0.5, 2.0)))


@given(st.sampled_from(["living", "bedroom", "kitchen", "bath", "office", "meeting", "lounge"]), numbers)
@settings(max_examples=20, deadline=None)
def test_a_draw_is_sensible_and_repeats(type_: str, number: int) -> None:
    wanted = draw(type_, 15.0, seeded(str(number)))
    assert wanted == draw(type_, 15.0, seeded(str(number)))
    kinds_ = [w.kind for w in wanted]
    if type_ == "bedroom":
        assert len({k for k in kinds_ if k.endswith("bed")}) == 1
    assert kinds_.count("tv") + kinds_.count("tv on a stand") <= 1
    assert kinds_.count("refrigerator") <= 1


def test_rooms_hold_what_the_train_homes_hold() -> None:
    """The share of living rooms drawn with a television, and so on, is the measured one."""
    rng = np.random.default_rng(3)
    for type_, kind in (("living", "plant"), ("kitchen", "table"), ("bath", "washing machine"), ("bedroom", "table")):
        share = room_statistics()[type_].pieces[kind].share
        found = np.mean([any(w.kind == kind for w in draw(type_, 12.0, rng)) for _ in range(800)])
        assert found == pytest.approx(share, abs=0.05)


def test_numbers_make_different_plans_and_the_same_twice() -> None:
    first = generated_home("office_3")
    generated_home.cache_clear()
    assert generated_home("office_3") == first
    assert generated_home("office_4") != first
    floors = {len(generated_home(f"{kind}_{n}").levels) for kind in KINDS for n in range(12)}
    assert floors >= {1, 2, 3}


@pytest.mark.parametrize(
    "name", ["office", "office_", "office_-1", "office_01", "offices_1", "flats_1.5", "flats_9" + "9" * 30]
)
def test_names_that_are_none(name: str) -> None:
    with pytest.raises(ValueError, match="office_<n>"):
        generated_home(name)
