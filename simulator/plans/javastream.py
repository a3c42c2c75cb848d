"""Java's serialized objects as plain data: what Sweet Home 3D wrote before it wrote XML.

The format is the Java Object Serialization Stream Protocol, version 5 (Java Object Serialization Specification, chapter 6).
No class is looked up and no code of the stream's is run: an object is its class's name and its fields. The bytes may come
from anybody. Reading takes no recursion, and everything that a stream can ask for is counted before it is given.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, NoReturn

from surveilnav.errors import BuildingError

#: How every stream begins: the magic number and the version.
MAGIC = b"\xac\xed\x00\x05"

MAX_BYTES = 64 << 20
#: Fields, elements of arrays and what objects wrote themselves, all together.
MAX_VALUES = 2_000_000
#: Objects, arrays, strings and classes: a plan of 10,000 pieces has about half of them.
MAX_OBJECTS = 300_000
#: Walls hang on each other: a plan of 5,000 joined walls is as deep.
MAX_DEPTH = 20_000
#: From a class to the first of its ancestors.
MAX_ANCESTORS = 16

_NULL, _REFERENCE, _CLASSDESC, _OBJECT, _STRING, _ARRAY, _CLASS = 0x70, 0x71, 0x72, 0x73, 0x74, 0x75, 0x76
_BLOCK, _END_BLOCK, _LONG_BLOCK, _LONG_STRING, _ENUM = 0x77, 0x78, 0x7A, 0x7C, 0x7E
_FIRST_HANDLE = 0x7E0000
_WRITES_ITSELF, _SERIALIZABLE, _EXTERNALIZABLE, _IN_BLOCKS = 0x01, 0x02, 0x04, 0x08
#: Type codes of primitives, as ``struct`` has them.
_PRIMITIVES = {"B": "b", "C": "H", "D": "d", "F": "f", "I": "i", "J": "q", "S": "h", "Z": "?"}
_CONTROLS = re.compile(r"[\x00-\x1f\x7f]")

_Step = Generator[Any, Any, Any]


@dataclass(slots=True, eq=False)
class JavaObject:
    """An object: its class's name, its fields (its ancestors' among them), and what its class wrote by itself.

    A value is None, a bool, an int, a float, a str (of enums: the constant's name), a list (arrays) or a JavaObject.
    Objects may hold each other in circles. ``written`` has blocks of bytes beside values.
    """

    class_name: str
    fields: dict[str, Any] = field(default_factory=dict)
    written: list[Any] = field(default_factory=list)


@dataclass(slots=True, eq=False)
class _Class:
    """A class as the stream describes it; ``whole`` once all of it is read."""

    name: str
    flags: int = 0
    fields: list[tuple[str, str]] = field(default_factory=list)
    parent: _Class | None = None
    whole: bool = False


def read_java(data: bytes, source: str) -> Any:
    """The first value of a stream.

    Raises:
        BuildingError: no such stream, cut short, damaged, or larger than the limits; the message names the byte.
    """
    if not data.startswith(MAGIC):
        raise BuildingError(f"{source} is no Java object: expected the bytes {MAGIC.hex(' ')} first, got {data[:4]!r}")
    if len(data) > MAX_BYTES:
        raise BuildingError(f"{source} is {len(data) >> 20} MiB of Java objects; at most {MAX_BYTES >> 20} are read")
    return _Reader(data, source).run()


class _Reader:
    """Reads values off a stream; each rule of the grammar that nests is a generator that yields what it needs read."""

    def __init__(self, data: bytes, source: str) -> None:
        self._data, self._source, self._at = data, source, len(MAGIC)
        self._handles: list[Any] = []
        self._values = 0

    def run(self) -> Any:
        """Runs the rules on a stack of our own, so that no stream can exhaust Python's."""
        stack: list[_Step] = [self._value()]
        result: Any = None
        while stack:
            try:
                needed = stack[-1].send(result)
            except StopIteration as done:
                stack.pop()
                result = done.value
                continue
            if len(stack) >= MAX_DEPTH:
                self._refuse(f"objects nested deeper than {MAX_DEPTH}")
            stack.append(needed)
            result = None
        return result

    def _refuse(self, what: str) -> NoReturn:
        raise BuildingError(f"{self._source}: {what} at byte {self._at} of its Java objects: damaged, or none of ours")

    def _count(self, values: int) -> None:
        self._values += values
        if self._values > MAX_VALUES:
            self._refuse(f"more than {MAX_VALUES} values")

    def _read_bytes(self, count: int) -> bytes:
        end = self._at + count
        if not 0 <= count <= len(self._data) - self._at:
            self._refuse(f"{count} more bytes expected, {len(self._data) - self._at} are there")
        taken, self._at = self._data[self._at : end], end
        return taken

    def _number(self, code: str) -> Any:
        return struct.unpack(f">{code}", self._read_bytes(struct.calcsize(f">{code}")))[0]

    def _text(self, length_code: str = "H") -> str:
        """A string in Java's modified UTF-8: zero is C0 80, what lies beyond 16 bits is a pair of surrogates."""
        raw = self._read_bytes(self._number(length_code)).replace(b"\xc0\x80", b" ")
        try:
            text = raw.decode("utf-8", "surrogatepass")
        except UnicodeDecodeError:
            self._refuse("a string that is no text")
        if not text.isprintable():
            text = text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
            text = _CONTROLS.sub(" ", text)
        return text

    def _new_handle(self, value: Any) -> int:
        if len(self._handles) >= MAX_OBJECTS:
            self._refuse(f"more than {MAX_OBJECTS} objects")
        self._handles.append(value)
        return len(self._handles) - 1

    def _referred(self) -> Any:
        number = self._number("i") - _FIRST_HANDLE
        if not 0 <= number < len(self._handles):
            self._refuse(f"a reference to object {number} of {len(self._handles)}")
        return self._handles[number]

    def _value(self) -> _Step:
        """Any value: null, a reference, a string, an object, an array, an enum's constant, a class."""
        code = self._number("B")
        if code == _NULL:
            return None
        if code == _REFERENCE:
            return self._referred()
        if code in (_STRING, _LONG_STRING):
            text = self._text("H" if code == _STRING else "Q")
            self._new_handle(text)
            return text
        rule = {_OBJECT: self._object, _ARRAY: self._array, _ENUM: self._enum, _CLASS: self._class}.get(code)
        if rule is None:
            self._refuse(f"a value of the unknown kind 0x{code:02x}")
        return (yield rule())

    def _description(self) -> _Step:
        code = self._number("B")
        if code == _NULL:
            return None
        if code == _REFERENCE:
            known = self._referred()
            if not isinstance(known, _Class):
                self._refuse("a class expected, a reference to something else found")
            return known
        if code != _CLASSDESC:
            self._refuse(f"a class expected, the kind 0x{code:02x} found")
        described = _Class(self._text())
        self._read_bytes(8)  # the version of the class
        self._new_handle(described)
        described.flags = self._number("B")
        count = self._number("H")
        self._count(count)
        for _ in range(count):
            type_code, name = chr(self._number("B")), self._text()
            if type_code not in _PRIMITIVES:
                if type_code not in "L[":
                    self._refuse(f"a field of the unknown type {type_code!r}")
                yield self._value()  # the name of the field's class: its value says what it is
            described.fields.append((type_code, name))
        yield self._written()
        described.parent = yield self._description()
        described.whole = True
        return described

    def _written(self) -> _Step:
        """Blocks of bytes and values, up to the mark that ends them."""
        found: list[Any] = []
        while True:
            self._count(1)
            if self._at >= len(self._data):
                self._refuse("the end of the file")
            code = self._data[self._at]
            if code in (_BLOCK, _LONG_BLOCK):
                self._at += 1
                found.append(self._read_bytes(self._number("B" if code == _BLOCK else "i")))
            elif code == _END_BLOCK:
                self._at += 1
                return found
            else:
                found.append((yield self._value()))

    def _lineage(self, described: _Class | None) -> list[_Class]:
        """A class and its ancestors, the first ancestor first."""
        line: list[_Class] = []
        while described is not None:
            line.append(described)
            if not described.whole or len(line) > MAX_ANCESTORS:
                self._refuse(
                    f"class {described.name[:60]!r} has more than {MAX_ANCESTORS} ancestors, or itself for one"
                )
            described = described.parent
        if not line:
            self._refuse("an object without a class")
        return line[::-1]

    def _object(self) -> _Step:
        line = self._lineage((yield self._description()))
        value = JavaObject(line[-1].name)
        self._new_handle(value)
        for described in line:
            if described.flags & _SERIALIZABLE:
                self._count(len(described.fields))
                for code, name in described.fields:
                    primitive = _PRIMITIVES.get(code)
                    value.fields[name] = self._number(primitive) if primitive else (yield self._value())
            elif described.flags & _EXTERNALIZABLE and not described.flags & _IN_BLOCKS:
                self._refuse(f"class {described.name[:60]!r} has a format of its own")
            if described.flags & (_WRITES_ITSELF | _EXTERNALIZABLE):
                value.written += yield self._written()
        return value

    def _array(self) -> _Step:
        name = self._lineage((yield self._description()))[-1].name
        if len(name) < 2 or name[0] != "[":
            self._refuse(f"an array of the class {name[:60]!r}")
        elements: list[Any] = []
        self._new_handle(elements)
        count = self._number("i")
        if count < 0:
            self._refuse(f"an array of {count} elements")
        self._count(count)
        primitive = _PRIMITIVES.get(name[1])
        if primitive:
            layout = f">{count}{primitive}"
            elements += struct.unpack(layout, self._read_bytes(struct.calcsize(layout)))
        else:
            for _ in range(count):
                elements.append((yield self._value()))
        return elements

    def _enum(self) -> _Step:
        self._lineage((yield self._description()))
        number = self._new_handle("")
        constant = yield self._value()
        if not isinstance(constant, str):
            self._refuse("an enum's constant without a name")
        self._handles[number] = constant
        return constant

    def _class(self) -> _Step:
        value = JavaObject("java.lang.Class", {"name": self._lineage((yield self._description()))[-1].name})
        self._new_handle(value)
        return value
