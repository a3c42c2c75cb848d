"""Homes as serialized Java objects: the same plan as in XML, and whatever else may stand in such a file."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.plans import javastream
from surveilnav.simulator.plans.javahome import home_element
from surveilnav.simulator.plans.javastream import MAGIC, JavaObject, read_java
from surveilnav.simulator.plans.sweethome import Home, read_home

HOMES = Path(__file__).parent / "homes"
MODEL = "com.eteks.sweethome3d.model."
NULL = b"\x70"


def entry(file: str, name: str) -> bytes:
    with zipfile.ZipFile(HOMES / file) as archive:
        return archive.read(name)


@pytest.fixture(scope="module")
def old() -> bytes:
    return entry("before_5_3.sh3d", "Home")


def utf(text: str) -> bytes:
    raw = text.encode()
    return struct.pack(">H", len(raw)) + raw


def described(name: str, fields: str = "", parent: bytes = NULL, flags: int = 2) -> bytes:
    """A class; ``fields``: "I:version L:walls"."""
    listed = [word.split(":") for word in fields.split()]
    body = b"".join(
        code.encode() + utf(field) + (b"\x74" + utf("Lx;") if code in "L[" else b"") for code, field in listed
    )
    return b"\x72" + utf(name) + bytes(8) + struct.pack(">BH", flags, len(listed)) + body + b"\x78" + parent


def thing(name: str, fields: str = "", *values: bytes) -> bytes:
    return b"\x73" + described(name, fields) + b"".join(values)


def text(value: str) -> bytes:
    return b"\x74" + utf(value)


def array(kind: str, count: int, body: bytes = b"") -> bytes:
    return b"\x75" + described(kind) + struct.pack(">i", count) + body


def listing(*values: bytes) -> bytes:
    described_list = described("java.util.ArrayList", "I:size", flags=3)
    return (
        b"\x73" + described_list + struct.pack(">i", len(values)) + b"\x77\x04" + bytes(4) + b"".join(values) + b"\x78"
    )


def reference(number: int) -> bytes:
    return b"\x71" + struct.pack(">i", 0x7E0000 + number)


def home(fields: str, *values: bytes) -> bytes:
    return MAGIC + thing(f"{MODEL}Home", fields, *values)


def number(value: float) -> bytes:
    return struct.pack(">f", value)


def test_the_same_home_before_and_since_version_5_3(old: bytes) -> None:
    mine, theirs = read_home(old, "old"), read_home(entry("since_5_3.sh3d", "Home.xml"), "new")
    assert mine == theirs
    assert mine.name == "Größe 床 🛏.sh3d"
    assert [len(part) for part in (mine.levels, mine.walls, mine.rooms, mine.pieces)] == [2, 8, 2, 8]
    assert [p.name for p in mine.pieces] == ["Bett", "Shelf", "Stairs", "Porte", "Lamp", "Stuhl", "Stuhl", "Tisch"]
    assert mine.pieces[0].model == "1/the box.obj"
    walls = {wall.id: wall for wall in mine.walls}
    assert all(walls[walls[wall.at_end].at_start] is wall for wall in mine.walls)
    assert mine.walls[0].arc_rad == pytest.approx(-0.7)


def test_a_version_without_ids_levels_and_groups() -> None:
    joined = "F:xStart F:yStart F:xEnd F:yEnd F:thickness L:wallAtEnd"
    first = thing(f"{MODEL}Wall", joined, *map(number, (0, 0, 100, 0, 10)), NULL)
    piece = thing(
        f"{MODEL}HomePieceOfFurniture",
        "L:name F:x F:y F:width F:depth F:height Z:doorOrWindow",
        text("Door"),
        *map(number, (50, 0, 90, 10, 200)),
        b"\x01",
    )
    plan = read_home(home("F:wallHeight L:walls L:furniture", number(240), listing(first), listing(piece)), "1.0")
    assert (plan.wall_height_m, plan.levels, plan.rooms) == (2.4, (), ())
    assert [(wall.id, wall.end_m, wall.height_m) for wall in plan.walls] == [("wall0", (1.0, -0.0), None)]
    assert [(p.name, p.size_m, p.is_opening) for p in plan.pieces] == [("Door", (0.9, 0.1, 2.0), True)]


def test_values_of_every_kind() -> None:
    value = read_java(
        MAGIC
        + thing(
            "T",
            "B:b C:c D:d F:f I:i J:j S:s Z:z [:a L:e L:o L:k L:t",
            struct.pack(">bHdfiqh?", -1, 65, 0.5, 1.5, -2, 3, 4, True),
            array("[S", 2, b"\0\1\xff\xff"),
            b"\x7e" + described("E", flags=0x12) + text("ON"),
            NULL,
            b"\x76" + described("K"),
            b"\x74\x00\x03a\xc0\x80",
        ),
        "test",
    )
    assert isinstance(value, JavaObject)
    fields = dict(value.fields)
    assert fields.pop("k").fields == {"name": "K"}
    assert fields == {
        "b": -1,
        "c": 65,
        "d": 0.5,
        "f": 1.5,
        "i": -2,
        "j": 3,
        "s": 4,
        "z": True,
        "a": [1, -1],
        "e": "ON",
        "o": None,
        "t": "a ",
    }


def test_walls_that_all_hang_on_each_other_take_no_recursion() -> None:
    # Java writes the next wall inside the one before: 5,000 of them are 5,000 deep.
    wall = described(f"{MODEL}Wall", "F:xStart F:yStart F:xEnd F:yEnd F:thickness L:wallAtEnd")
    lone = b"\x73%s" + struct.pack(">5f", 0, 0, 100, 0, 10)
    count = 5_000
    # Handles: class Home 0, "Lx;" 1, home 2, class ArrayList 3, list 4, class Wall 5, "Lx;" 6, walls 7...
    chain = lone.replace(b"%s", wall) + lone.replace(b"%s", reference(5)) * (count - 1) + NULL
    walls = [reference(7 + i) for i in range(1, count)]
    plan = read_home(home("L:walls", listing(chain, *walls)), "chain")
    assert len(plan.walls) == count
    assert plan.walls[0].at_end == "wall1"


@pytest.mark.parametrize("count", range(0, 12_793, 97))
def test_a_home_cut_short_is_refused(old: bytes, count: int) -> None:
    with pytest.raises(BuildingError, match="cut"):
        read_home(old[:count], "cut")


def test_a_home_with_flipped_bytes_is_refused_or_read(old: bytes) -> None:
    rng = np.random.default_rng(27)
    refused: list[str] = []
    for _ in range(300):
        data = bytearray(old)
        for at in rng.integers(4, len(data), rng.integers(1, 4)):
            data[at] = rng.integers(256)
        try:
            assert isinstance(read_home(bytes(data), "flipped"), Home)
        except BuildingError as error:
            refused.append(str(error))
    assert 50 < len(refused) < 300
    assert max(map(len, refused)) < 400


PIECE = f"{MODEL}HomePieceOfFurniture"
BOX = "F:x F:y F:width F:depth F:height"


def box(*values: float) -> bytes:
    return b"".join(map(number, values))


HOSTILE: dict[str, tuple[bytes | Callable[[], bytes], str]] = {
    "nothing": (MAGIC, "1 more bytes expected, 0 are there"),
    "another class": (MAGIC + thing("java.util.Date"), "expected an object of the class .*Home, got 'java.util.Date'"),
    "a string": (MAGIC + text("home"), "got 'str'"),
    "an exception": (MAGIC + b"\x7b", "unknown kind 0x7b"),
    "a reset": (MAGIC + b"\x79", "unknown kind 0x79"),
    "a proxy": (MAGIC + b"\x73\x7d", "a class expected"),
    "no class": (MAGIC + b"\x73\x70", "without a class"),
    "a reference to nothing": (MAGIC + reference(0), "a reference to object 0 of 0"),
    "a reference before the first": (MAGIC + reference(-1), "a reference to object -1"),
    "an object for a class": (home("L:a", b"\x73" + reference(2)), "a class expected"),
    "its own parent": (MAGIC + b"\x73" + described(f"{MODEL}Home", parent=reference(0)), "ancestors"),
    "many parents": (lambda: MAGIC + b"\x73" + _parents(40), "more than 16 ancestors"),
    "parents without end": (lambda: MAGIC + b"\x73" + _parents(30_000), "nested deeper"),
    "a huge array": (home("L:walls", array("[LWall;", 2**31 - 1)), "more than 2000000 values"),
    "a large array of nothing": (home("L:walls", array("[D", 1_999_000)), "15992000 more bytes expected"),
    "an array of -1": (home("L:walls", array("[LWall;", -1)), "an array of -1 elements"),
    "an array of no kind": (home("L:walls", array("Wall", 1)), "an array of the class 'Wall'"),
    "a huge string": (home("L:name", b"\x7c" + struct.pack(">Q", 2**63)), "more bytes expected"),
    "a huge block": (home("L:a", b"\x73" + described("T", flags=3) + b"\x7a" + struct.pack(">i", -5)), "more bytes"),
    "no text": (home("L:name", b"\x74\x00\x02\xff\xff"), "no text"),
    "a field of no type": (MAGIC + b"\x73\x72" + utf("A") + bytes(8) + b"\x02\x00\x01Q" + utf("a"), "unknown type 'Q'"),
    "a format of its own": (home("L:a", b"\x73" + described("T", flags=4)), "format of its own"),
    "blocks without end": (home("L:a", b"\x73" + described("T", flags=3) + b"\x77\x00" * 99), "end of the file"),
    "deep": (lambda: MAGIC + thing("T", "L:a") + (b"\x73" + reference(0)) * 30_000, "nested deeper"),
    "walls that are text": (home("L:walls", text("walls")), "'walls' of a Home can't be 'walls'"),
    "walls that are a map": (home("L:walls", thing("java.util.HashMap")), "can't be java.util.HashMap"),
    "a wall that is text": (home("L:walls", listing(text("wall"))), "'walls' of a Home can't be 'wall'"),
    "a list that holds itself": (
        home("L:walls", thing("java.util.Collections$List", "L:list", reference(5))),
        "'walls'",
    ),
    "not a number": (home("L:furniture", listing(thing(PIECE, BOX, box(float("nan"), 0, 1, 1, 1)))), "'x' of <pieceOf"),
    "far away": (home("L:furniture", listing(thing(PIECE, BOX, box(1e30, 0, 1, 1, 1)))), "'x' of <pieceOf"),
    "beyond float": (home("D:wallHeight", struct.pack(">d", 1e300)), "'wallHeight'"),
    "text for a number": (home("L:wallHeight", text("tall")), "'wallHeight' .* must be a number"),
    "a size that is missing": (home("L:furniture", listing(thing(PIECE))), "is missing"),
    "a model nowhere": (
        home("L:furniture", listing(thing(PIECE, "L:model", thing("a.URLContent", "L:url", NULL)))),
        "'url' of a a.URLContent",
    ),
    "a point of one number": (
        home("L:rooms", listing(thing(f"{MODEL}Room", "[:points", array("[[F", 1, array("[F", 1, number(1)))))),
        "'points'",
    ),
    "points that are text": (
        home("L:rooms", listing(thing(f"{MODEL}Room", "[:points", text("p")))),
        "'points' of a Room",
    ),
    "a crooked rotation": (
        home("L:furniture", listing(thing(PIECE, "[:modelRotation", array("[[F", 1, NULL)))),
        "'modelRotation'",
    ),
    "a group that holds itself": (
        # Handles: class Home 0, "Lx;" 1, home 2, class ArrayList 3, list 4, class group 5, "Lx;" 6, group 7.
        home("L:furniture", listing(thing(f"{MODEL}HomeFurnitureGroup", "L:furniture", reference(4)))),
        "things nested",
    ),
    "a texture of itself": (
        # ... class piece 5, "Lx;" 6, piece 7, class texture 8, "Lx;" 9, texture 10.
        home(
            "L:furniture", listing(thing(PIECE, "L:texture", thing(f"{MODEL}HomeTexture", "L:texture", reference(10))))
        ),
        "things nested",
    ),
}


def _parents(count: int) -> bytes:
    return described(f"{MODEL}Home")[:-1] * count + NULL


@pytest.mark.parametrize("case", HOSTILE)
def test_what_cannot_be_is_refused_by_name(case: str) -> None:
    data, says = HOSTILE[case]
    with pytest.raises(BuildingError, match=says) as caught:
        read_home(data if isinstance(data, bytes) else data(), "test")
    assert len(str(caught.value)) < 400


def test_one_room_many_times_over_is_counted() -> None:
    # Handles: class Home 0, "Lx;" 1, home 2, class ArrayList 3, list 4, class Room 5, "Lx;" 6, room 7, class [[F 8,
    # points 9, class [F 10, point 11: 600 rooms of 1,000 corners, in 6 kB.
    point = array("[F", 2, number(1) * 2)
    room = thing(f"{MODEL}Room", "[:points", array("[[F", 1000, point + reference(11) * 999))
    data = home("L:rooms", listing(room, *[reference(7)] * 599))
    with pytest.raises(BuildingError, match="more than 5000 things"):
        home_element(data, "test", max_elements=5_000, max_depth=64)


def test_too_many_objects(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(javastream, "MAX_OBJECTS", 1_000)
    with pytest.raises(BuildingError, match="more than 1000 objects"):
        read_home(home("[:a", array("[LT;", 1_500, thing("T") + (b"\x73" + reference(5)) * 1_499)), "test")


def test_too_many_bytes(monkeypatch: pytest.MonkeyPatch, old: bytes) -> None:
    monkeypatch.setattr(javastream, "MAX_BYTES", 1000)
    with pytest.raises(BuildingError, match="MiB of Java objects"):
        read_home(old, "test")
