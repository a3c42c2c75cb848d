"""Sweet Home 3D's plans as plain data, in the world frame: metres, z up, angles counter-clockwise.

The file has centimetres, y down in the plan, angles clockwise. It may come from anybody: document types and
entities are refused, every number is checked, and whatever is wrong is named in a ``BuildingError``.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from urllib.parse import unquote

from surveilnav.errors import BuildingError
from surveilnav.simulator.plans.javahome import home_element
from surveilnav.simulator.plans.javastream import MAGIC

Color = tuple[float, float, float]

MAX_ELEMENTS = 500_000
MAX_DEPTH = 64
MAX_PIECES = 10_000
MAX_WALLS = 5_000
MAX_ROOMS = 2_000
MAX_ROOM_CORNERS = 1_000
MAX_GROUP_DEPTH = 16
#: Nothing in a building is further away than this, or larger [cm].
_FAR_CM = 1_000_000.0
_LARGE_CM = 100_000.0


@dataclass(frozen=True, slots=True)
class Picture:
    """A texture in the file: where its image lies and how much it covers [m]."""

    path: str
    width_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Level:
    id: str
    name: str
    z_m: float
    height_m: float
    slab_m: float


@dataclass(frozen=True, slots=True)
class PlanWall:
    """A wall's centre line; ``arc_rad`` is the angle that an arc wall spans, else 0."""

    id: str
    level: str
    start_m: tuple[float, float]
    end_m: tuple[float, float]
    thickness_m: float
    height_m: float | None = None
    end_height_m: float | None = None
    arc_rad: float = 0.0
    at_start: str = ""
    at_end: str = ""
    left: Color | None = None
    right: Color | None = None
    left_picture: Picture | None = None
    right_picture: Picture | None = None


@dataclass(frozen=True, slots=True)
class PlanRoom:
    """A room's outline (x, y) [m]."""

    name: str
    level: str
    outline_m: tuple[tuple[float, float], ...]
    floor: bool = True
    ceiling: bool = True
    ceiling_color: Color | None = None
    floor_picture: Picture | None = None


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of furniture, door, window or light.

    ``size_m``: width, depth, height; ``z_m``: its foot above the level's floor; ``yaw_rad`` about z;
    ``pitch_rad``, ``roll_rad`` as in Sweet Home 3D; ``rotation``: the OBJ's own 3x3, row-major, y up.
    """

    name: str
    level: str
    catalog_id: str
    model: str
    x_m: float
    y_m: float
    z_m: float
    size_m: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    mirrored: bool = False
    rotation: tuple[float, ...] | None = None
    color: Color | None = None
    is_opening: bool = False
    stair_cut: str = ""
    material_colors: dict[str, Color] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Home:
    name: str
    wall_height_m: float
    levels: tuple[Level, ...]
    walls: tuple[PlanWall, ...]
    rooms: tuple[PlanRoom, ...]
    pieces: tuple[Piece, ...]


def parse_xml(data: bytes, source: str) -> ET.Element:
    """Parses XML without document types, entities or anything from outside, and returns the root element.

    Raises:
        BuildingError: it isn't well-formed, holds a document type, or exceeds the limits.
    """
    parser = ET.XMLParser(target=_LimitedBuilder(source))
    try:
        parser.feed(data)
        root: ET.Element = parser.close()
    except ET.ParseError as error:
        raise BuildingError(f"{source} is no well-formed XML ({error})") from error
    except (AssertionError, LookupError, ValueError) as error:  # LookupError: an encoding that nobody knows
        raise BuildingError(f"{source} is no XML that can be read ({error})") from error
    return root


class _LimitedBuilder(ET.TreeBuilder):
    """Builds a tree without text, and refuses document types and trees that are too large or too deep."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self._source, self._count, self._depth = source, 0, 0

    def start(self, tag: str, attributes: dict[str, str]) -> ET.Element:  # type: ignore[override]
        self._count += 1
        self._depth += 1
        if self._count > MAX_ELEMENTS or self._depth > MAX_DEPTH:
            raise BuildingError(
                f"{self._source}: more than {MAX_ELEMENTS} elements, or nested deeper than {MAX_DEPTH}: refused"
            )
        return super().start(tag, attributes)

    def end(self, tag: str) -> ET.Element:
        self._depth -= 1
        return super().end(tag)

    def data(self, text: str) -> None:  # type: ignore[override]
        """Text between elements says nothing in a Home.xml."""

    def doctype(self, *_: object) -> None:
        raise BuildingError(
            f"{self._source}: a document type or entity declaration has no place in a Home.xml: refused"
        )


def read_home(data: bytes, source: str) -> Home:
    """The plan of a Home.xml, or of the serialized ``Home`` that versions before 5.3 wrote.

    Raises:
        BuildingError: not a home, or a value that can't be; the message names the attribute.
    """
    if data.startswith(MAGIC):
        root = home_element(data, source, max_elements=MAX_ELEMENTS, max_depth=MAX_DEPTH)
    else:
        root = parse_xml(data, source)
    if root.tag != "home":
        raise BuildingError(
            f"{source}: expected a <home> element as in Sweet Home 3D's Home.xml, got <{root.tag[:40]}>"
        )
    pieces = [piece for element in root for piece in _pieces(element, "", source, 0)]
    walls = tuple(_wall(e, source) for e in root.findall("wall"))
    counts = (len(pieces), len(walls), len(root.findall("room")))
    if counts[0] > MAX_PIECES or counts[1] > MAX_WALLS or counts[2] > MAX_ROOMS:
        raise BuildingError(
            f"{source} has {counts[0]} pieces, {counts[1]} walls, {counts[2]} rooms; "
            f"at most {MAX_PIECES}, {MAX_WALLS}, {MAX_ROOMS}"
        )
    return Home(
        name=root.get("name", ""),
        wall_height_m=_number(root, "wallHeight", source, 250.0, 1.0, _LARGE_CM) / 100,
        levels=tuple(_plan_level(e, source) for e in root.findall("level")),
        walls=walls,
        rooms=tuple(_room(e, source) for e in root.findall("room")),
        pieces=tuple(pieces),
    )


def _number(
    element: ET.Element,
    name: str,
    source: str,
    default: float | None = None,
    low: float = -_FAR_CM,
    high: float = _FAR_CM,
) -> float:
    """A number of an element's attribute between ``low`` and ``high``."""
    text = element.get(name)
    which = f"{source}: {name!r} of <{element.tag}> {(element.get('name') or element.get('id') or '')[:40]!r}"
    if text is None:
        if default is None:
            raise BuildingError(f"{which} is missing")
        return default
    try:
        value = float(text)
    except ValueError as error:
        raise BuildingError(f"{which} must be a number, got {text[:40]!r}") from error
    if not (math.isfinite(value) and low <= value <= high):
        raise BuildingError(f"{which} must lie between {low:g} and {high:g}, got {text[:40]!r}")
    return value


def _color(element: ET.Element, name: str, source: str) -> Color | None:
    """sRGB 0-1 of an "AARRGGBB"."""
    text = element.get(name)
    if text is None:
        return None
    try:
        value = int(text, 16)
    except ValueError as error:
        raise BuildingError(
            f"{source}: {name!r} of <{element.tag}> must be like 'FFRRGGBB', got {text[:40]!r}"
        ) from error
    return ((value >> 16 & 255) / 255, (value >> 8 & 255) / 255, (value & 255) / 255)


def _picture(element: ET.Element, attribute: str, source: str) -> Picture | None:
    for child in element.findall("texture"):
        if child.get("attribute") == attribute:
            width = _number(child, "width", source, 100.0, 0.1, _LARGE_CM) / 100
            height = _number(child, "height", source, 100.0, 0.1, _LARGE_CM) / 100
            return Picture(_place(child, "image"), width, height)
    return None


def _place(element: ET.Element, name: str) -> str:
    """Where a model or picture lies in the file: a part of a URL, so that a space is %20 in it."""
    return unquote(element.get(name, ""))


def _point(element: ET.Element, x: str, y: str, source: str) -> tuple[float, float]:
    return _number(element, x, source) / 100, -_number(element, y, source) / 100


def _plan_level(e: ET.Element, source: str) -> Level:
    return Level(
        e.get("id", ""),
        e.get("name", ""),
        _number(e, "elevation", source, 0.0) / 100,
        _number(e, "height", source, 250.0, 1.0, _LARGE_CM) / 100,
        _number(e, "floorThickness", source, 12.0, 0.0, _LARGE_CM) / 100,
    )


def _wall(e: ET.Element, source: str) -> PlanWall:
    height = _number(e, "height", source, -1.0, -1.0, _LARGE_CM) / 100
    end_height = _number(e, "heightAtEnd", source, -1.0, -1.0, _LARGE_CM) / 100
    return PlanWall(
        e.get("id", ""),
        e.get("level", ""),
        _point(e, "xStart", "yStart", source),
        _point(e, "xEnd", "yEnd", source),
        _number(e, "thickness", source, 7.5, 0.01, _LARGE_CM) / 100,
        height if height >= 0 else None,
        end_height if end_height >= 0 else None,
        -_number(e, "arcExtent", source, 0.0, -6.2, 6.2),
        e.get("wallAtStart", ""),
        e.get("wallAtEnd", ""),
        _color(e, "leftSideColor", source),
        _color(e, "rightSideColor", source),
        _picture(e, "leftSideTexture", source),
        _picture(e, "rightSideTexture", source),
    )


def _room(e: ET.Element, source: str) -> PlanRoom:
    points = e.findall("point")
    if len(points) > MAX_ROOM_CORNERS:
        raise BuildingError(f"{source}: a room has at most {MAX_ROOM_CORNERS} corners, got {len(points)}")
    return PlanRoom(
        e.get("name", "").strip(),
        e.get("level", ""),
        tuple(_point(p, "x", "y", source) for p in points),
        e.get("floorVisible", "true") != "false",
        e.get("ceilingVisible", "true") != "false",
        _color(e, "ceilingColor", source),
        _picture(e, "floorTexture", source),
    )


def _pieces(e: ET.Element, level: str, source: str, depth: int) -> Iterator[Piece]:
    """The pieces of an element; a group's children carry absolute coordinates, and its level where they have none."""
    if (
        e.tag not in ("pieceOfFurniture", "doorOrWindow", "light", "shelfUnit", "furnitureGroup")
        or e.get("visible") == "false"
    ):
        return
    level = e.get("level", level)
    if e.tag == "furnitureGroup":
        if depth >= MAX_GROUP_DEPTH:
            raise BuildingError(f"{source}: groups nested deeper than {MAX_GROUP_DEPTH}: refused")
        for child in e:
            yield from _pieces(child, level, source, depth + 1)
        return
    yield _piece(e, level, source)


def _rotation(e: ET.Element, source: str) -> tuple[float, ...] | None:
    """The OBJ's own 3x3 rotation, row-major; None where there is none."""
    if not e.get("modelRotation"):
        return None
    words = e.get("modelRotation", "").split()
    try:
        rotation = tuple(float(word) for word in words)
    except ValueError:
        rotation = ()
    if len(rotation) != 9 or not all(math.isfinite(v) and abs(v) <= 10 for v in rotation):
        raise BuildingError(
            f"{source}: 'modelRotation' of {e.get('name', '')[:40]!r} must be nine numbers, "
            f"got {' '.join(words)[:60]!r}"
        )
    return rotation


def _piece(e: ET.Element, level: str, source: str) -> Piece:
    rotation = _rotation(e, source)
    x, y = _point(e, "x", "y", source)
    return Piece(
        name=e.get("name", ""),
        level=level,
        catalog_id=e.get("catalogId", ""),
        model=_place(e, "model"),
        x_m=x,
        y_m=y,
        z_m=_number(e, "elevation", source, 0.0) / 100,
        size_m=(
            _number(e, "width", source, None, 0.0, _LARGE_CM) / 100,
            _number(e, "depth", source, None, 0.0, _LARGE_CM) / 100,
            _number(e, "height", source, None, 0.0, _LARGE_CM) / 100,
        ),
        yaw_rad=-_number(e, "angle", source, 0.0),
        pitch_rad=_number(e, "pitch", source, 0.0),
        roll_rad=_number(e, "roll", source, 0.0),
        mirrored=e.get("modelMirrored") == "true",
        rotation=rotation,
        color=_color(e, "color", source),
        is_opening=e.tag == "doorOrWindow" or e.get("doorOrWindow") == "true",
        stair_cut=e.get("staircaseCutOutShape", ""),
        material_colors={
            m.get("name", "").lower(): color
            for m in e.findall("material")
            if (color := _color(m, "color", source)) is not None
        },
    )
