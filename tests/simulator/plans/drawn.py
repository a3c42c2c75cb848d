"""Small plans drawn here, each with one fault that people's plans have.

    python -m tests.simulator.plans.drawn FOLDER
    surveilnav homes FOLDER

writes them as files and says how much of each robots reach.
"""

from __future__ import annotations

import sys
import zipfile
from itertools import pairwise
from pathlib import Path

# A door of one width with the wall, its leaf in a group that says nothing: frame of 5 cm posts and a lintel, leaf between.
LEAF_DOOR = """
g Rahmen
v -50 0 -6
v -45 0 -6
v -45 203 -6
v 45 203 -6
v 45 0 -6
v 50 0 -6
v 50 208 -6
v -50 208 -6
f 1 2 3 4 5 6 7 8
v -50 0 6
v -45 0 6
v -45 203 6
v 45 203 6
v 45 0 6
v 50 0 6
v 50 208 6
v -50 208 6
f 9 16 15 14 13 12 11 10
g Porte
v -45 1 -2
v 45 1 -2
v 45 203 -2
v -45 203 -2
f 17 18 19 20
v -45 1 2
v 45 1 2
v 45 203 2
v -45 203 2
f 21 24 23 22
"""


def wall(x0: int, y0: int, x1: int, y1: int, level: str = "") -> str:
    return f"<wall level='{level}' xStart='{x0}' yStart='{y0}' xEnd='{x1}' yEnd='{y1}' thickness='20' height='250'/>"


def walls_around(x0: int, y0: int, x1: int, y1: int, level: str = "") -> str:
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    return "".join(wall(*a, *b, level=level) for a, b in pairwise(corners))


def room(x0: int, y0: int, x1: int, y1: int, level: str = "", more: str = "") -> str:
    points = "".join(f"<point x='{x}' y='{y}'/>" for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
    return f"<room level='{level}' {more}>{points}</room>"


def level(name: str, elevation: float, height: float = 250) -> str:
    return f"<level id='{name}' name='{name}' elevation='{elevation}' floorThickness='12' height='{height}'/>"


def door(x: int, y: int, more: str = "name='Door' catalogId='eTeks#door'", level: str = "") -> str:
    """Across a wall that runs up and down the plan."""
    return (
        f"<doorOrWindow x='{x}' y='{y}' angle='1.5707963' width='100' depth='12' height='208' level='{level}' {more}/>"
    )


#: Two rooms of 4 x 4 m side by side, 0.2 m of wall between: the frame of most plans here.
TWO_ROOMS = walls_around(0, 0, 820, 420) + wall(410, 0, 410, 420)

_ROOMS = room(10, 10, 400, 410) + room(420, 10, 810, 410)


def stairs(x: int, level: str) -> str:
    return (
        f"<pieceOfFurniture name='Stairs' level='{level}' x='{x}' y='200' width='90' depth='240' height='362' "
        "staircaseCutOutShape='M0,0 v1 h1 v-1 z'/>"
    )


#: By fault, a plan with it. All of each should be reached.
FAULTS: dict[str, str] = {
    "walls without rooms": TWO_ROOMS + door(410, 210),
    "a room for a part only": TWO_ROOMS + door(410, 210) + room(10, 10, 400, 410),
    "rooms that end before the wall": TWO_ROOMS + door(410, 210) + room(15, 15, 390, 405) + room(430, 15, 805, 405),
    "a doorway that a room covers in part": TWO_ROOMS
    + door(410, 210)
    + room(10, 10, 413, 410)
    + room(420, 10, 810, 410),
    "a cellar below an undrawn hall": level("cellar", -262)
    + level("down", 0)
    + level("up", 262)
    + "".join(walls_around(0, 0, 820, 420, name) for name in ("cellar", "down", "up"))
    + room(10, 10, 810, 410, "up")
    + stairs(250, "down")
    + stairs(600, "cellar")
    + room(10, 10, 500, 410, "down"),
    "a false ceiling below the stairs' end": level("down", 0)
    + level("false ceiling", 242, 18)
    + level("up", 262)
    + "".join(room(0, 0, 800, 400, name) for name in ("down", "false ceiling", "up"))
    + stairs(400, "down"),
    "two levels at one altitude": level("walls", 0)
    + level("rooms", 0)
    + walls_around(0, 0, 420, 420, "walls")
    + room(10, 10, 410, 200, "rooms"),
    "a leaf without a name": TWO_ROOMS + _ROOMS + door(410, 210, "model='door.obj' name='Porte'"),
    "a front door indoors": TWO_ROOMS
    + _ROOMS
    + door(410, 210, "model='door.obj' name='Haustür' catalogId='eTeks#frontDoor'"),
    "a bed in another language": walls_around(0, 0, 420, 420)
    + room(10, 10, 410, 410)
    + "<pieceOfFurniture name='Кровать' x='300' y='300' width='90' depth='200' height='50'/>",
    "a piece nine kilometres away": walls_around(0, 0, 420, 420)
    + room(10, 10, 410, 410)
    + "<pieceOfFurniture name='Box' x='900000' y='0' width='50' depth='50' height='50'/>",
    "walls that span 150 m": walls_around(0, 0, 15_000, 3_000),
}


def plan_of(body: str) -> bytes:
    """A ``Home.xml``."""
    return f"<home version='7000' wallHeight='250'>{body}</home>".encode()


def write(folder: Path) -> None:
    """Every plan as a .sh3d file, and one in the format of before Sweet Home 3D 5.3."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, body in FAULTS.items():
        with zipfile.ZipFile(folder / f"{name}.sh3d", "w") as file:
            file.writestr("Home.xml", plan_of(body))
            file.writestr("door.obj", LEAF_DOOR)
    old = Path(__file__).parent / "homes" / "before_5_3.sh3d"
    (folder / "a file of before version 5.3.sh3d").write_bytes(old.read_bytes())


if __name__ == "__main__":
    write(Path(sys.argv[1]))
