from __future__ import annotations

import math

import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.plans.openings import path_points, stands_open
from surveilnav.simulator.plans.sweethome import Home, read_home


def home(body: str, attributes: str = "") -> Home:
    return read_home(f"<home version='7000' {attributes}>{body}</home>".encode(), "test")


def test_centimetres_become_metres_and_the_plan_is_turned_over() -> None:
    it = home(
        "<level id='l' name='1st' elevation='262' height='240' floorThickness='12'/>"
        "<wall id='w' level='l' xStart='100' yStart='200' xEnd='300' yEnd='200' thickness='10' height='250'"
        " heightAtEnd='100' leftSideColor='FFFF8000'/>"
        "<room name=' Hall ' level='l' floorVisible='false'>"
        "<point x='0' y='0'/><point x='100' y='0'/><point x='0' y='50'/></room>"
        "<pieceOfFurniture name='Bed' level='l' catalogId='A#b' x='10' y='20' elevation='5' angle='1.5'"
        " width='100' depth='200'"
        " height='50' color='FF0000FF' modelMirrored='true'><material name='Wood' color='FF00FF00'/></pieceOfFurniture>"
    )
    (level,), (wall,), (room,), (bed,) = it.levels, it.walls, it.rooms, it.pieces
    assert (level.z_m, level.height_m, level.slab_m) == (2.62, 2.4, 0.12)
    assert (wall.start_m, wall.end_m, wall.height_m, wall.end_height_m) == ((1, -2), (3, -2), 2.5, 1.0)
    assert wall.left == (1.0, 128 / 255, 0.0)
    assert (room.name, room.floor, room.ceiling, room.outline_m) == ("Hall", False, True, ((0, 0), (1, 0), (0, -0.5)))
    assert (bed.x_m, bed.y_m, bed.z_m, bed.yaw_rad) == (0.1, -0.2, 0.05, -1.5)
    assert (bed.size_m, bed.mirrored, bed.color) == ((1, 2, 0.5), True, (0, 0, 1))
    assert bed.material_colors == {"wood": (0, 1, 0)}


SIZE = "width='1' depth='1' height='1'"


def test_groups_give_their_level_and_nothing_else() -> None:
    it = home(
        f"<furnitureGroup level='l' x='900' y='900' {SIZE}><pieceOfFurniture name='a' x='1' y='2' {SIZE}/>"
        f"<furnitureGroup x='0' y='0' {SIZE}><light name='b' x='3' y='4' {SIZE}/></furnitureGroup>"
        f"<pieceOfFurniture name='hidden' visible='false' x='1' y='2' {SIZE}/></furnitureGroup>"
    )
    assert [(p.name, p.level, p.x_m) for p in it.pieces] == [("a", "l", 0.01), ("b", "l", 0.03)]


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (f"<pieceOfFurniture name='Bed' x='nan' y='0' {SIZE}/>", "'x' of <pieceOfFurniture> 'Bed'"),
        (f"<pieceOfFurniture name='Bed' x='0' y='1e30' {SIZE}/>", "'y' of <pieceOfFurniture> 'Bed'"),
        (f"<pieceOfFurniture name='Bed' x='0' {SIZE}/>", "'y' of .* is missing"),
        (f"<pieceOfFurniture name='Bed' x='0' y='0' elevation='inf' {SIZE}/>", "'elevation'"),
        (f"<pieceOfFurniture name='Bed' x='0' y='0' angle='much' {SIZE}/>", "'angle' .* must be a number, got 'much'"),
        ("<pieceOfFurniture name='Bed' x='0' y='0' width='-1' depth='1' height='1'/>", "'width'"),
        (f"<pieceOfFurniture name='Bed' x='0' y='0' color='red' {SIZE}/>", "'color'"),
        (f"<pieceOfFurniture name='Bed' x='0' y='0' modelRotation='1 2 nan' {SIZE}/>", "'modelRotation'"),
        ("<wall id='w' xStart='0' yStart='0' xEnd='0' yEnd='-inf' thickness='1'/>", "'yEnd' of <wall> 'w'"),
        ("<wall id='w' xStart='0' yStart='0' xEnd='0' yEnd='0' thickness='0'/>", "'thickness'"),
        ("<wall id='w' xStart='0' yStart='0' xEnd='0' yEnd='0' thickness='1' arcExtent='99'/>", "'arcExtent'"),
        ("<level id='l' elevation='1e9'/>", "'elevation' of <level>"),
        ("<room>" + "<point x='0' y='0'/>" * 1001 + "</room>", "at most 1000 corners"),
        (f"<furnitureGroup x='0' y='0' {SIZE}>" * 20 + "</furnitureGroup>" * 20, "nested deeper"),
        ("<a>" * 100 + "</a>" * 100, "nested deeper"),
    ],
)
def test_a_value_that_cannot_be_is_named(body: str, says: str) -> None:
    with pytest.raises(BuildingError, match=says):
        home(body)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no well-formed XML"),
        (b"<home>", "no well-formed XML"),
        (b"PK\x03\x04", "no well-formed XML"),
        (b"<html/>", "expected a <home> element"),
        (b"<!DOCTYPE home [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;&a;'>]><home name='&b;'/>", "refused"),
        (b"<!DOCTYPE home SYSTEM 'http://example.invalid/home.dtd'><home/>", "refused"),
        (b"<!DOCTYPE home [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><home>&x;</home>", "refused"),
        (b"<home>&unknown;</home>", "no well-formed XML"),
        (b"<?xml version='1.0' encoding='nonsense'?><home/>", "no well-formed XML|no XML"),
    ],
)
def test_hostile_xml_is_refused(data: bytes, says: str) -> None:
    with pytest.raises(BuildingError, match=says):
        read_home(data, "test")


def test_too_many_pieces() -> None:
    with pytest.raises(BuildingError, match="at most 10000"):
        home(f"<light x='0' y='0' {SIZE}/>" * 10_001)


@pytest.mark.parametrize(
    ("name", "catalog", "height", "z", "opens"),
    [
        ("Door", "eTeks#door", 208, 0, True),
        ("Front door", "eTeks#frontDoor", 208, 0, False),
        ("Garage door", "eTeks#garageDoor", 208, 0, False),
        ("Small window", "eTeks#window85x123", 123, 100, False),
        ("Tall window", "eTeks#fixedWindow85x123", 230, 0, False),  # the catalogue knows it better than its size
        ("Terrasse", "eTeks#doubleFrenchWindow126x200", 200, 0, True),
        ("Passage", "", 208, 0, True),  # nothing says what it is, but people can walk through
        ("Thatched door", "", 208, 0, True),  # no "hatch"
        ("Frontal", "front#slidingDoor", 208, 0, True),  # no front door; the author's name says nothing
        ("Fahrstuhl", "", 208, 0, False),
        ("Drzwi windy", "", 208, 0, False),
        ("Hissdörr", "", 208, 0, False),
        ("Garagentor", "", 208, 0, False),
        ("Drzwi wejściowe", "", 208, 0, False),
        ("车库门", "", 208, 0, False),
    ],
)
def test_which_doors_stand_open(name: str, catalog: str, height: int, z: int, opens: bool) -> None:
    it = home(
        f"<doorOrWindow name='{name}' catalogId='{catalog}' x='0' y='0' width='90' depth='9' "
        f"height='{height}' elevation='{z}'/>"
    )
    assert [stands_open(piece) for piece in it.pieces] == [opens]


@pytest.mark.parametrize(
    ("path", "points"),
    [
        ("M0,0 v1 h1 v-1 z", [(0, 0), (0, 1), (1, 1), (1, 0)]),
        ("M0.5,0 L1,1 0,1 0.5,0 Z", [(0.5, 0), (1, 1), (0, 1)]),
        ("M0,0 C0,0 0,1 1,1 l0,-1z", [(0, 0), (1, 1), (1, 0)]),
        ("", []),
        ("L", []),
        ("M0,0 L1e99,0 0,1z", []),
    ],
)
def test_cut_out_paths(path: str, points: list[tuple[float, float]]) -> None:
    assert [tuple(p) for p in path_points(path)] == points


def test_an_arc_wall_bulges_the_right_way() -> None:
    from surveilnav.simulator.plans.straight_walls import arc_points

    # Sweet Home 3D: from (0, 0) to (100, 0) with a positive extent of pi, in a plan whose y looks down.
    (wall,) = home(
        "<wall id='w' xStart='0' yStart='0' xEnd='100' yEnd='0' thickness='10' arcExtent='3.1415927'/>"
    ).walls
    points = arc_points(wall)
    assert points[0] == (0, 0)
    assert points[-1] == (1, 0)
    radii = [math.dist(p, (0.5, 0)) for p in points]
    assert radii == pytest.approx([0.5] * len(points), abs=1e-6)
