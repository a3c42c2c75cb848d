"""Small plans, each with one fault that people's plans have, and how much of them robots reach."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from surveilnav.simulator.archive import Archive
from surveilnav.simulator.plans.homes import build_home
from surveilnav.simulator.plans.sweethome import read_home
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.reach import reach_of
from surveilnav.simulator.world.scene import Scene
from tests.simulator.plans.drawn import (
    FAULTS,
    LEAF_DOOR,
    TWO_ROOMS,
    door,
    level,
    plan_of,
    room,
    stairs,
    wall,
    walls_around,
)

BED = "<pieceOfFurniture name='Bed' level='{}' x='200' y='200' width='90' depth='200' height='50'/>"
#: A robot's centre keeps 0.18 m and a cell from walls: of 16 m² it can stand on this much.
ONE_ROOM_M2 = pytest.approx(12.8, abs=0.5)
BOTH_ROOMS_M2 = pytest.approx(26.0, abs=1.0)


def scene_of(body: str, archive: Archive | None = None) -> Scene:
    return build_home(read_home(plan_of(body), "test"), "test", 0, None, archive, "test")


def reached(scene: Scene) -> dict[str, float]:
    """Area [m²] of every floor that robots reach."""
    navigation = NavigationMap.build(scene)
    return {floor: float(cells.sum()) * 0.05**2 for floor, cells in navigation.robot_area.items()}


def test_walls_alone_have_a_floor_between_them() -> None:
    scene = scene_of(TWO_ROOMS + door(410, 210))
    assert reached(scene) == {"0": BOTH_ROOMS_M2}
    assert {room.name for room in scene.rooms} == {
        "Unnamed area 1 on Ground floor",
        "Unnamed area 2 on Ground floor",
    }
    assert sum(i.label == "ceiling" for i in scene.instances) == 2


def test_what_is_left_undrawn_beside_rooms_has_a_floor_too() -> None:
    scene = scene_of(TWO_ROOMS + door(410, 210) + room(10, 10, 400, 410, more="name='Hall'"))
    assert reached(scene) == {"0": BOTH_ROOMS_M2}
    assert [room.name for room in scene.rooms] == ["Hall", "Unnamed area on Ground floor"]


def test_a_gap_in_the_outer_wall_is_no_way_for_the_floor_to_run_out() -> None:
    whole = reached(scene_of(TWO_ROOMS + door(410, 210)))["0"]
    open_front = wall(0, 0, 820, 0) + wall(820, 0, 820, 420) + wall(820, 420, 500, 420) + wall(400, 420, 0, 420)
    open_front += wall(0, 420, 0, 0) + wall(410, 0, 410, 420)
    assert reached(scene_of(open_front + door(410, 210)))["0"] == pytest.approx(whole, abs=1.0)


def test_nothing_is_laid_outside_of_the_walls() -> None:
    scene = scene_of(TWO_ROOMS)
    floors = [i for i in scene.instances if i.label == "floor"]
    assert min(i.p_min[0] for i in floors) > -0.1
    assert max(i.p_max[0] for i in floors) < 8.3


def test_rooms_that_end_before_the_wall_are_one_floor_with_the_doorway() -> None:
    rooms = room(15, 15, 390, 405) + room(430, 15, 805, 405)
    assert reached(scene_of(TWO_ROOMS + door(410, 210) + rooms)) == {"0": BOTH_ROOMS_M2}


@pytest.mark.parametrize("border", [401, 408, 412, 419])
def test_a_doorway_that_a_room_covers_in_part_is_passable(border: int) -> None:
    rooms = room(10, 10, border, 410) + room(420, 10, 810, 410)
    assert reached(scene_of(TWO_ROOMS + door(410, 210) + rooms)) == {"0": BOTH_ROOMS_M2}


def test_an_open_well_on_an_upper_storey_stays_open() -> None:
    levels = level("down", 0) + level("up", 262)
    walls = walls_around(0, 0, 820, 420, "down") + walls_around(0, 0, 820, 420, "up")
    drawn = room(10, 10, 810, 410, "down") + room(10, 10, 500, 410, "up")
    scene = scene_of(levels + walls + drawn)
    assert {room.floor: room.name for room in scene.rooms} == {"0": "Room 1", "1": "Room 2"}


def test_an_entrance_storey_over_a_basement_has_a_floor_where_no_room_is_drawn() -> None:
    levels = level("cellar", -262) + level("entrance", 0)
    walls = walls_around(0, 0, 820, 420, "cellar") + walls_around(0, 0, 820, 420, "entrance")
    scene = scene_of(levels + walls + room(10, 10, 810, 410, "cellar") + room(10, 10, 500, 410, "entrance"))
    assert [room.name for room in scene.rooms if room.floor == "0"] == ["Room 2", "Unnamed area on entrance"]


def test_a_room_without_a_floor_has_ground_below_and_is_open_above() -> None:
    hidden = "name='Hidden' floorVisible='false'"
    ground = scene_of(TWO_ROOMS + door(410, 210) + room(10, 10, 400, 410) + room(420, 10, 810, 410, more=hidden))
    assert reached(ground) == {"0": BOTH_ROOMS_M2}
    levels = level("down", 0) + level("up", 262)
    walls = "".join(TWO_ROOMS.replace("level=''", f"level='{name}'") for name in ("down", "up"))
    drawn = room(10, 10, 810, 410, "down") + room(10, 10, 400, 410, "up") + room(420, 10, 810, 410, "up", hidden)
    scene = scene_of(levels + walls + drawn)
    assert [room.name for room in scene.rooms if room.floor == "1"] == ["Room 2"]


def test_an_upper_storey_has_a_floor_where_nothing_is_below() -> None:
    levels = level("down", 0) + level("up", 262)
    walls = walls_around(0, 0, 500, 420, "down") + walls_around(0, 0, 820, 420, "up")
    scene = scene_of(levels + walls + room(10, 10, 490, 410, "down") + room(10, 10, 500, 410, "up"))
    assert [room.name for room in scene.rooms if room.floor == "1"] == ["Room 2", "Unnamed area on up"]


def test_an_upper_storey_without_rooms_has_a_floor_where_something_stands_on_it() -> None:
    levels = level("down", 0) + level("up", 262) + level("Dach", 524)
    walls = "".join(walls_around(0, 0, 820, 420, name) for name in ("down", "up", "Dach"))
    scene = scene_of(levels + walls + BED.format("up") + BED.format("Dach"))
    assert [floor.id for floor in scene.floors] == ["0", "1"]
    assert {room.floor for room in scene.rooms} == {"0", "1"}


@pytest.mark.parametrize(
    ("name", "height", "drawn", "why"),
    [
        ("Dach", 250, "", "its name says roof"),
        ("Roof", 250, room(10, 10, 810, 410, "Roof"), "nothing stands in a room on it"),
        ("Attic", 120, room(10, 10, 810, 410, "Attic"), "it is 1.2 m high"),
        ("Top", 250, "", "nothing stands between its walls"),
        ("Roof", 250, room(10, 10, 810, 410, "Roof") + BED.format("Roof"), ""),
    ],
)
def test_a_level_that_is_no_floor_is_named_with_the_reason(name: str, height: float, drawn: str, why: str) -> None:
    levels = level("down", 0) + level(name, 262, height)
    walls = "".join(walls_around(0, 0, 820, 420, each) for each in ("down", name))
    scene = scene_of(levels + walls + room(10, 10, 810, 410, "down") + drawn)
    assert [floor.name for floor in scene.floors] == (["down"] if why else ["down", name])
    assert [note for note in scene.notes if "is no floor" in note] == [
        note for note in scene.notes if why and note.startswith(f"level {name!r} is no floor:") and why in note
    ]
    assert bool(why) == any("is no floor" in note for note in scene.notes)


@pytest.mark.parametrize("drawn", ["", room(10, 10, 410, 410, "low")])
def test_where_the_only_level_is_too_low_its_ceiling_is_the_reason(drawn: str) -> None:
    scene = scene_of(level("low", 0, 60) + walls_around(0, 0, 420, 420, "low") + drawn)
    sentence = reach_of(scene, NavigationMap.build(scene)).sentence
    assert sentence == "robots reach 0 of 0 m²: the ceiling is too low for a robot on level 0"


def test_levels_at_one_altitude_are_one_floor() -> None:
    levels = level("walls", 0) + level("rooms", 0)
    scene = scene_of(levels + walls_around(0, 0, 420, 420, "walls") + room(10, 10, 410, 200, "rooms"))
    assert [floor.name for floor in scene.floors] == ["rooms"]
    assert reached(scene) == {"0": ONE_ROOM_M2}


@pytest.mark.parametrize("low", [0, 262, 275])
@pytest.mark.parametrize(("apart", "floors"), [(9, 1), (10, 1), (11, 2)])
def test_ten_centimetres_are_one_floor_everywhere(low: int, apart: int, floors: int) -> None:
    """For the storeys, for the rooms on them and for the ground between: 2.62 and 2.72 m differ by more than 0.1 in floats."""
    levels = level("ground", 0, 200) + level("lower", low) + level("upper", low + apart)
    drawn = room(0, 0, 400, 400, "ground") + room(0, 0, 400, 400, "lower") + room(400, 0, 800, 400, "upper")
    scene = scene_of(levels + drawn)
    upper = scene.floors[-floors:]
    assert len(scene.floors) == floors + (low > 0)
    assert [room.floor for room in scene.rooms][-2:] == [upper[0].id, upper[-1].id]
    assert {i.name: i.floor for i in scene.instances if i.label == "floor"}["Floor of Room 2"] == upper[0].id


def test_a_false_ceiling_is_no_floor_and_lets_the_stairs_through() -> None:
    levels = level("down", 0) + level("false ceiling", 242, 18) + level("up", 262)
    drawn = "".join(room(0, 0, 800, 400, name) for name in ("down", "false ceiling", "up"))
    thing = "<pieceOfFurniture name='Lamp' level='false ceiling' x='700' y='50' width='20' depth='20' height='10'/>"
    stairs = (
        "<pieceOfFurniture name='Stairs' level='down' x='400' y='200' width='90' depth='240' height='362' "
        "staircaseCutOutShape='M0,0 v1 h1 v-1 z'/>"
    )
    scene = scene_of(levels + drawn + thing + stairs)
    assert [(floor.id, floor.name) for floor in scene.floors] == [("0", "down"), ("1", "up")]
    assert next(i.floor for i in scene.instances if i.name == "Lamp") == "0"
    assert [(room.name, room.floor) for room in scene.rooms] == [("Room 1", "0"), ("Room 3", "1")]
    assert all(area > 20 for area in reached(scene).values())


@pytest.fixture
def archive(tmp_path: Path) -> Archive:
    """A file with one model, a door whose leaf has no name that we know."""
    with zipfile.ZipFile(tmp_path / "home.sh3d", "w") as file:
        file.writestr("door.obj", LEAF_DOOR)
    return Archive(tmp_path / "home.sh3d")


def test_a_staircase_without_steps_is_named(archive: Archive) -> None:
    levels = level("down", 0) + level("up", 262)
    drawn = "".join(room(0, 0, 800, 400, name) for name in ("down", "up"))
    hollow = stairs(400, "down").replace("name='Stairs'", "name='Shaft' model='door.obj'")
    assert "'Shaft' has no steps from level 0 to 1: no stair" in scene_of(levels + drawn + hollow, archive).notes
    assert scene_of(levels + drawn + stairs(400, "down"), archive).stairs


_ROOMS = room(10, 10, 400, 410) + room(420, 10, 810, 410)


@pytest.mark.parametrize(
    ("words", "passable"),
    [
        ("name='Door' catalogId='eTeks#door'", True),
        ("name='Tür'", True),
        ("name='Zwischenstück'", True),  # by its foot and height alone
        ("name='Haustür'", True),  # inside the building it leads to no street
        ("name='Front door' catalogId='eTeks#frontDoor'", True),
        ("name='Garagentor' catalogId='eTeks#garageDoor'", False),
        ("name='Porte de garage'", False),
    ],
)
def test_a_door_inside_loses_its_leaf_by_whatever_name(archive: Archive, words: str, passable: bool) -> None:
    scene = scene_of(TWO_ROOMS + _ROOMS + door(410, 210, f"model='door.obj' {words}"), archive)
    assert reached(scene) == {"0": BOTH_ROOMS_M2 if passable else ONE_ROOM_M2}
    (frame,) = (i for i in scene.instances if i.label == "door")
    assert frame.p_max[2] == pytest.approx(2.08)  # the frame stays
    assert frame.p_max[1] - frame.p_min[1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("words", ["name='Front door'", "name='Haustür'", "name='Porte d’entrée'", "name='前门'"])
def test_a_door_to_the_street_stays_shut(archive: Archive, words: str) -> None:
    terrace = room(420, 10, 810, 410, more="ceilingVisible='false'")
    scene = scene_of(
        TWO_ROOMS + room(10, 10, 400, 410) + terrace + door(410, 210, f"model='door.obj' {words}"), archive
    )
    assert reached(scene) == {"0": ONE_ROOM_M2}


@pytest.mark.parametrize("fault", FAULTS)
def test_all_of_a_drawn_plan_is_reached(archive: Archive, fault: str) -> None:
    scene = scene_of(FAULTS[fault], archive)
    reach = reach_of(scene, NavigationMap.build(scene))
    assert reach.reached_m2 > 0.98 * reach.free_m2 > 0.0, reach.sentence
