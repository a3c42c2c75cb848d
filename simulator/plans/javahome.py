"""A home as Sweet Home 3D saved it before version 5.3, as the elements of a Home.xml.

The entry ``Home`` of a .sh3d file is a serialized Java object. Its classes' fields have the names that Home.xml has for its
attributes (versions 1.0 to 7.x; older ones have fewer). So one reader, ``sweethome.read_home``, checks both.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from surveilnav.errors import BuildingError
from surveilnav.simulator.plans.javastream import JavaObject, read_java

_MODEL = "com.eteks.sweethome3d.model."
#: Classes of furniture whose element isn't <pieceOfFurniture>.
_TAGS = {
    "HomeDoorOrWindow": "doorOrWindow",
    "HomeLight": "light",
    "HomeFurnitureGroup": "furnitureGroup",
    "HomeShelfUnit": "shelfUnit",
}
#: Lists of parts that become elements within their owner's.
_PARTS = {"modelMaterials": "material", "sashes": "sash"}
#: Where the furniture stands, by what the version that wrote the file knew: groups, else doors, else pieces alone.
_FURNITURE = ("furnitureWithGroups", "furnitureWithDoorsAndWindows", "furniture")
#: Around a list: java.util.Collections' views of one, and Arrays.asList.
_WRAPPED = ("list", "c", "a", "element")
_MAX_WRAPS = 8
_MAX_PATH = 1_000
_UPRIGHT = "1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0"


def home_element(data: bytes, source: str, *, max_elements: int, max_depth: int) -> ET.Element:
    """The <home> element of a serialized home.

    Args:
        data: the entry ``Home``.
        source: for messages.
        max_elements, max_depth: of the tree.

    Raises:
        BuildingError: no such object, damaged, beyond a limit, or with a value of a kind that can't be.
    """
    home = read_java(data, source)
    if not isinstance(home, JavaObject) or home.class_name != f"{_MODEL}Home":
        found = home.class_name if isinstance(home, JavaObject) else type(home).__name__
        raise BuildingError(f"{source}: expected an object of the class {_MODEL}Home, got {found[:80]!r}")
    return _Writer(source, max_elements, max_depth).home(home)


class _Writer:
    """Writes elements, and counts them: objects may hold the same part many times over, or themselves."""

    def __init__(self, source: str, max_elements: int, max_depth: int) -> None:
        self._source, self._left, self._max_depth = source, max_elements, max_depth
        self._max_elements = max_elements
        #: Levels and walls that others refer to.
        self._ids: dict[int, str] = {}

    def home(self, home: JavaObject) -> ET.Element:
        """The whole plan."""
        root = self._element("home", home)
        levels, walls = (self._objects(home, name) for name in ("levels", "walls"))
        for kind, several in (("level", levels), ("wall", walls)):
            for number, one in enumerate(several):
                given = one.fields.get("id")
                self._ids[id(one)] = given if isinstance(given, str) and given else f"{kind}{number}"
        for level in levels:
            root.append(self._element("level", level))
        furniture = next((name for name in _FURNITURE if home.fields.get(name) is not None), "")
        for piece in self._objects(home, furniture):
            root.append(self._piece(piece, 0))
        for wall in walls:
            root.append(self._element("wall", wall))
        for room in self._objects(home, "rooms"):
            root.append(self._room(room))
        return root

    def _piece(self, piece: JavaObject, depth: int) -> ET.Element:
        """A piece of furniture; a group has others in it."""
        self._refuse_depth(depth)
        element = self._element(_TAGS.get(piece.class_name.removeprefix(_MODEL), "pieceOfFurniture"), piece)
        for child in self._objects(piece, "furniture") if element.tag == "furnitureGroup" else ():
            element.append(self._piece(child, depth + 1))
        return element

    def _room(self, room: JavaObject) -> ET.Element:
        element = self._element("room", room)
        for point in self._list(room, "points"):
            if not isinstance(point, list) or len(point) < 2:
                raise self._wrong(room, "points", point)
            self._count_element()
            ET.SubElement(element, "point", x=_text(point[0]), y=_text(point[1]))
        return element

    def _refuse_depth(self, depth: int) -> None:
        if depth >= self._max_depth:
            raise BuildingError(
                f"{self._source}: things nested deeper than {self._max_depth}, or in themselves: refused"
            )

    def _element(self, tag: str, of: JavaObject, depth: int = 0) -> ET.Element:
        """An element with the object's plain fields as attributes, its textures and parts below."""
        self._refuse_depth(depth)
        self._count_element()
        element = ET.Element(tag)
        for name, value in of.fields.items():
            if name in _PARTS and value is not None:
                for part in self._objects(of, name):
                    element.append(self._element(_PARTS[name], part, depth + 1))
            elif name == "modelRotation" and value is not None:
                element.set(name, self._rotation(of))
            elif isinstance(value, JavaObject) and value.class_name == f"{_MODEL}HomeTexture":
                element.append(self._element("texture", value, depth + 1))
                element[-1].set("attribute", name)
            elif (text := self._attribute(name, value)) is not None:
                element.set(name, text)
        if id(of) in self._ids:
            element.set("id", self._ids[id(of)])
        if element.get("modelRotation") == _UPRIGHT:
            del element.attrib["modelRotation"]
        return element

    def _attribute(self, name: str, value: Any) -> str | None:
        """A field as an attribute; None for what Home.xml has none for."""
        if isinstance(value, JavaObject):
            if id(value) in self._ids:
                return self._ids[id(value)]
            if value.class_name.endswith("URLContent"):
                return self._path(value)
            value = value.fields.get("value") if value.class_name.startswith("java.lang.") else None
        if value is None or isinstance(value, list | JavaObject):
            return None
        if isinstance(value, int) and name.lower().endswith("color"):
            return f"{value & 0xFFFFFFFF:08X}"
        return _text(value)

    def _path(self, content: JavaObject) -> str:
        """Where a model or a picture lies in its archive: what follows "!/" of "jar:file:temp!/3/bed.obj"."""
        url = content.fields.get("url")
        path = url.fields.get("file") if isinstance(url, JavaObject) else None
        if not isinstance(path, str) or len(path) > _MAX_PATH:
            raise self._wrong(content, "url", path)
        return path.partition("!/")[2]

    def _rotation(self, piece: JavaObject) -> str:
        """Nine numbers, row by row."""
        rows = self._list(piece, "modelRotation")
        if len(rows) > 3 or not all(isinstance(row, list) and len(row) <= 3 for row in rows):
            raise self._wrong(piece, "modelRotation", rows)
        return " ".join(_text(number) for row in rows for number in row)

    def _objects(self, of: JavaObject, name: str) -> list[JavaObject]:
        """The objects of a list, without its gaps; [] where an older version had none."""
        found = [value for value in self._list(of, name) if value is not None]
        strange = next((value for value in found if not isinstance(value, JavaObject)), None)
        if strange is not None:
            raise self._wrong(of, name, strange)
        return found

    def _list(self, of: JavaObject, name: str) -> list[Any]:
        """An array's elements, or a java.util list's."""
        value = of.fields.get(name)
        for _ in range(_MAX_WRAPS):
            if value is None:
                return []
            if isinstance(value, list):
                return value
            if not isinstance(value, JavaObject):
                break
            if value.class_name in ("java.util.ArrayList", "java.util.LinkedList"):
                return [v for v in value.written if not isinstance(v, bytes)]
            if value.class_name == "java.util.Collections$EmptyList":
                return []
            inner = next((n for n in _WRAPPED if value.fields.get(n) is not None), None)
            if not value.class_name.startswith("java.util.") or inner is None:
                break
            value = [value.fields[inner]] if inner == "element" else value.fields[inner]
        raise self._wrong(of, name, value)

    def _count_element(self) -> None:
        self._left -= 1
        if self._left < 0:
            raise BuildingError(f"{self._source}: more than {self._max_elements} things: refused")

    def _wrong(self, of: JavaObject, name: str, value: object) -> BuildingError:
        got = value.class_name if isinstance(value, JavaObject) else repr(value)
        return BuildingError(
            f"{self._source}: {name!r} of a {of.class_name.removeprefix(_MODEL)[:40]} can't be {got[:60]}: the file is damaged"
        )


def _text(value: Any) -> str:
    """A plain value as Home.xml spells it; numbers in the shortest form that a float32 has."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        with np.errstate(over="ignore"):
            return str(np.float32(value))
    return value if isinstance(value, str) else str(value)[:40]
