"""A hall and a smaller garage, a wall of 0.1 m between: what keeps robots out of the garage."""

from __future__ import annotations

import dataclasses

import pytest

from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.reach import reach_of
from surveilnav.simulator.world.scene import Room

HALL = Room("Hall", "0", ((0, 0), (4, 0), (4, 4), (0, 4)))
GARAGE = Room("Garage", "0", ((4.1, 0), (7.1, 0), (7.1, 4), (4.1, 4)))
ROBOT = "and a robot is 0.36 m wide"


def box(label: str, x0: float, y0: float, x1: float, y1: float, low: float = 0.0, high: float = 2.0):
    return (label, "0", (x0, y0, low), (x1, y1, high))


def wall_between(*gap: float):
    """The wall, with a gap from one y to another."""
    if not gap:
        return [box("wall", 4, 0, 4.1, 4, high=2.5)]
    return [box("wall", 4, 0, 4.1, gap[0], high=2.5), box("wall", 4, gap[1], 4.1, 4, high=2.5)]


@pytest.fixture
def why(boxes, room):
    def say(parts, rooms=(HALL, GARAGE), floor=None) -> str:
        shell = room(7.1, 4)
        scene = boxes([*(shell if floor is None else [*floor, *shell[1:]]), *parts])
        scene = dataclasses.replace(scene, rooms=tuple(rooms))
        gaps = reach_of(scene, NavigationMap.build(scene)).gaps
        return "; ".join(gaps).partition(" (Garage): ")[2] if gaps else ""

    return say


WIDE = (1.5, 2.5)
LEAF = box("door", 4, 1.5, 4.1, 2.5)
SILL = box("door", 4, 1.5, 4.1, 2.5, high=0.02)

CASES = {
    "an open passage": (wall_between(*WIDE), ""),
    "walls": (wall_between(), "walls stand between"),
    "a leaf": ([*wall_between(*WIDE), LEAF], "the door 'door-9' between Hall and Garage stays shut"),
    "two leaves": (
        [*wall_between(*WIDE), box("door", 4, 1.5, 4.1, 2.0), box("door", 4, 2.0, 4.1, 2.5)],
        "the door 'door-9' between Hall and Garage stays shut, the door 'door-10' between Hall and Garage stays shut",
    ),
    "a narrow door": (
        [*wall_between(1.5, 1.84), box("door", 3.95, 1.45, 4.15, 1.89, high=0.02)],
        f"the door 'door-9' between Hall and Garage leaves about 0.3 m, {ROBOT}",
    ),
    "a leaf in a narrow opening": (
        [*wall_between(1.5, 1.74), box("door", 4, 1.5, 4.1, 1.74)],
        f"the door 'door-9' between Hall and Garage leaves about 0.2 m, {ROBOT}",
    ),
    "a leaf over a sill": (
        [*wall_between(*WIDE), box("wall", 4, 1.5, 4.1, 2.5, high=0.12), box("door", 4, 1.5, 4.1, 2.5, low=0.12)],
        "the door 'door-10' between Hall and Garage stays shut and has a sill of 0.12 m",
    ),
    "an open door over a sill": (
        [
            *wall_between(*WIDE),
            box("wall", 4, 1.5, 4.1, 2.5, high=0.12),
            box("door", 4, 1.5, 4.1, 2.5, low=0.12, high=0.15),
        ],
        "the door 'door-10' between Hall and Garage has a sill of 0.12 m",
    ),
    "furniture before a door": (
        [*wall_between(*WIDE), SILL, box("chair", 4.1, 1.4, 4.6, 2.6)],
        "'chair-10' stands before the door 'door-9' between Hall and Garage",
    ),
    "furniture near a door": (
        [*wall_between(*WIDE), SILL, box("chair", 4.25, 1.2, 4.7, 2.8)],
        f"'chair-10' before the door 'door-9' between Hall and Garage leaves about 0.2 m, {ROBOT}",
    ),
    "furniture in a passage": ([*wall_between(*WIDE), box("chair", 4.1, 1.4, 4.6, 2.6)], "furniture stands in the way"),
    "furniture near a passage": (
        [*wall_between(*WIDE), box("chair", 4.25, 1.2, 4.7, 2.8)],
        f"furniture leaves about 0.2 m, {ROBOT}",
    ),
    "a gap": (wall_between(1.49, 1.81), f"the gap that leads there leaves about 0.3 m, {ROBOT}"),
    "a door elsewhere": ([*wall_between(), box("door", 1, 0, 2, 0.05)], "walls stand between"),
    "a door in a corner": ([*wall_between(), box("door", 3.0, 0, 3.9, 0.05)], "walls stand between"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_keeps_robots_out(why, case: str) -> None:
    parts, said = CASES[case]
    assert why(parts) == said


def test_an_open_door_is_not_to_blame_for_a_gap_beside_it(why) -> None:
    """The door leads from one part of the hall to the other, close by the gap to the garage."""
    across = [box("wall", 0, 2.7, 2.9, 2.8, high=2.5), box("wall", 3.9, 2.7, 4, 2.8, high=2.5)]
    door = box("door", 2.9, 2.65, 3.9, 2.85, high=0.02)
    assert why([*wall_between(2.3, 2.59), *across, door]) == f"the gap that leads there leaves about 0.3 m, {ROBOT}"


def test_no_floor(why) -> None:
    islands = [box("floor", -0.1, -0.1, 3.6, 4.1, -0.1, 0.0), box("floor", 4.6, -0.1, 7.2, 4.1, -0.1, 0.0)]
    assert why(wall_between(*WIDE), floor=islands) == "no floor lies between"


def test_names_are_cut_and_left_out_where_there_are_none(why) -> None:
    long = dataclasses.replace(HALL, name="x" * 99)
    assert f"between {'x' * 40} and Garage" in why([*wall_between(*WIDE), LEAF], rooms=(long, GARAGE))
    assert why([*wall_between(*WIDE), LEAF], rooms=(GARAGE,)) == "the door 'door-9' stays shut"
    same = dataclasses.replace(HALL, name="Garage")
    assert why([*wall_between(*WIDE), LEAF], rooms=(same, GARAGE)) == "the door 'door-9' in Garage stays shut"


def test_where_nobody_knows_what_is_a_wall_nothing_is_said_of_walls(boxes, room) -> None:
    parts = [("", floor, low, high) for _, floor, low, high in [*room(7.1, 4), *wall_between()]]
    scene = boxes(parts)
    assert reach_of(scene, NavigationMap.build(scene)).gaps == ("no way leads to 10 m² of level 0",)
    scene = boxes([*parts, SILL])
    assert reach_of(scene, NavigationMap.build(scene)).gaps == ("no way leads to 10 m² of level 0",)
