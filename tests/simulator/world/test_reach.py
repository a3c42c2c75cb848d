from __future__ import annotations

import dataclasses

import pytest

from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.reach import reach_of, survey
from surveilnav.simulator.world.scene import Floor, Room, Stair

LEVELS = (Floor("0", "ground", 0.0, 2.5), Floor("1", "first", 2.7, 2.5), Floor("2", "attic", 5.4, 2.5))
STAIR = Stair("0", "1", (1.0, 1.0, 0.0), (3.0, 1.0, 2.7), 4.0)
NOWHERE = Stair("0", "1", (1.0, 1.0, 0.0), (30.0, 1.0, 2.7), 4.0)


def bare(room, floor: str, z_m: float):
    """Walls alone."""
    return [box for box in room(6, 4, floor, z_m) if box[0] == "wall"]


@pytest.fixture
def said(boxes):
    def say(parts, floors=LEVELS[:1], stairs=(), rooms=()) -> str:
        scene = dataclasses.replace(boxes(parts, floors, stairs), rooms=tuple(rooms))
        return reach_of(scene, NavigationMap.build(scene)).sentence

    return say


def test_nothing_is_said_of_a_building_that_robots_reach(boxes, room, said) -> None:
    assert said(room(6, 4)) == ""
    two = [*room(6, 4), *room(6, 4, "1", 2.7)]
    assert said(two, LEVELS[:2], [STAIR]) == ""
    reach = reach_of(scene := boxes(two, LEVELS[:2], [STAIR]), NavigationMap.build(scene))
    assert reach.reached_m2 == pytest.approx(reach.free_m2)
    assert reach.free_m2 == pytest.approx(2 * 5.64 * 3.64, rel=0.03)
    assert [(f.id, f.name) for f in reach.floors] == [("0", "ground"), ("1", "first")]


def test_why_levels_cant_be_reached(room, said) -> None:
    two, ground = [*room(7, 4), *room(6, 4, "1", 2.7)], room(6, 4)
    assert said(two, LEVELS[:2]) == "robots reach 24 of 45 m²: no stair leads to level 1"
    assert said(two, LEVELS[:2], [NOWHERE]) == "robots reach 24 of 45 m²: the stair from 0 to 1 has no free place on 1"
    walls = [*ground, *bare(room, "1", 2.7), *bare(room, "2", 5.4)]
    assert said(walls, LEVELS) == "robots reach 21 of 21 m²: no floor is drawn on levels 1, 2"
    assert said(bare(room, "0", 0.0)) == "robots reach 0 of 0 m²: no floor is drawn on level 0"
    full = [*room(1, 1), ("", "0", (0.0, 0.0, 0.0), (1.0, 0.8, 2.0))]
    outline = Room("Store", "0", ((0, 0), (1, 0), (1, 1), (0, 1)))
    assert said(full, rooms=[outline]) == "robots reach 0 of 0 m²: there is hardly room for a robot on level 0"


def test_a_level_that_falls_into_gaps_lacks_room_and_no_stair(room, said) -> None:
    walls = [("wall", "0", (0.0, y, 0.0), (1.2, y + 0.1, 2.5)) for y in (1.2, 2.5, 3.8)]
    outline = Room("Cells", "0", ((0, 0), (1.2, 0), (1.2, 5), (0, 5)))
    assert said([*room(1.2, 5), *walls], rooms=[outline]).endswith(": there is hardly room for a robot on level 0")


def test_upper_levels_that_are_joined_to_each_other_alone(room, said) -> None:
    three = [*room(20, 4), *room(6, 4, "1", 2.7), *room(6, 4, "2", 5.4)]
    above = Stair("1", "2", (1.0, 1.0, 2.7), (3.0, 1.0, 5.4), 4.0)
    assert said(three, LEVELS, [NOWHERE, above]).endswith(
        "no stair leads from where robots live to levels 1, 2; the stair from 0 to 1 has no free place on 1"
    )


def test_shut_off_rooms_are_named_and_gaps_are_not(room, said) -> None:
    wall = ("wall", "0", (4.0, 0.0, 0.0), (4.1, 4.0, 2.5))
    garage = Room("Garage", "0", ((4.1, 0), (6, 0), (6, 4), (4.1, 4)))
    hall = Room("Hall", "0", ((0, 0), (4, 0), (4, 4), (0, 4)))
    assert said([*room(6, 4), wall], rooms=[hall, garage]) == (
        "robots reach 13 of 19 m²: no way leads to 6 m² of level 0 (Garage): walls stand between"
    )
    assert said([*room(6, 4), wall]) == "robots reach 13 of 19 m²: no way leads to 6 m² of level 0: walls stand between"
    many = [dataclasses.replace(garage, name=f"Room {n}") for n in range(5)]
    assert said([*room(6, 4), wall], rooms=many).endswith("(Room 0, Room 1, Room 2, 2 more): walls stand between")
    niche = ("wall", "0", (5.2, 0.0, 0.0), (5.3, 4.0, 2.5))  # 0.7 m wide behind it: 1.2 m² of free ground
    cupboard = ("", "0", (5.3, 1.5, 0.0), (6.0, 4.0, 2.5))
    assert said([*room(6, 4), niche, cupboard]) == "", "a gap behind a cupboard is nobody's loss"


def test_reasons_have_an_end(room, said) -> None:
    floors = [Floor(str(n), "", 2.7 * n, 2.5) for n in range(9)]
    stairs = [Stair("0", str(n), (1, 1, 0), (30, 1, 2.7 * n), 4.0) for n in range(1, 9)]
    parts = [box for f in floors for box in room(6, 4, f.id, f.z_m)]
    text = said(parts, floors, stairs)
    assert text.count("has no free place") == 6
    assert text.endswith("; and 2 more")


def test_targets_by_class_and_how_many_can_be_got_to(boxes, room) -> None:
    wall = ("wall", "0", (5.0, 0.0, 0.0), (5.1, 4.0, 2.5))
    things = [("chair", "0", (x, 1.0, 0.0), (x + 0.5, 1.5, 0.9)) for x in (1.0, 3.0, 7.0)]
    scene = boxes([*room(8.0, 4.0), wall, *things, ("bed", "0", (6.0, 2.0, 0.0), (7.9, 3.9, 0.5))])
    found = survey(scene, NavigationMap.build(scene))
    assert found.targets == {"bed": (0, 1), "chair": (2, 3)}
    assert found.rooms == 0
    assert found.reach.gaps == ("no way leads to 5 m² of level 0: walls stand between",)
