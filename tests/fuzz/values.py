"""Values of any type of the contract: plausible ones, and now and then one at the boundary of its type.

They are plain values, as a sender of any program would put them into MessagePack: a message with a NaN in it or with a negative
size still passes the check of its schema, and so reaches the code behind it.
"""

from __future__ import annotations

import dataclasses
import time
import types
import typing
from collections.abc import Callable
from functools import cache
from random import Random
from typing import Any

import msgspec

#: Ids that stand for things which the services of the fuzzer know.
NAMES: dict[str, tuple[Any, ...]] = {
    "floor": ("0", "1"),
    "to_floor": ("1", "0"),
    "camera": ("c1", "c2"),
    "robot": ("r1", "r2"),
    "mission": ("m1", "m2"),
    "worker": ("w1", "w2"),
    "fusion": ("f1",),
    "source": ("robot/r1", "camera/c1", "camera/c2"),
    "target": ("tv", "bed", "chair"),
    "label": ("tv", "bed", "chair"),
    "labels": ("tv", "bed", "chair"),
    "recorder": ("rec",),
    "player": ("replay",),
    "recording": ("2026-01-01T00-00-00.000000Z_m1",),
    "embedder": ("e1", "e2"),
    "dtype": ("uint8", "float32", "int64"),
    "epoch": ("a1", "b2"),
}
_ODD_INTEGERS = (0, -1, 1, 7, 255, 65_536, -(2**31), 2**31, 2**53, 2**62, 2**63 - 1, -(2**63), 2**64 - 1)
_ODD_FLOATS = (0.0, -0.0, -1.0, 1e-300, 5e-324, 1e6, 1e30, 1e308, -1e308, float("nan"), float("inf"), float("-inf"))
_ODD_TEXTS = (
    "",
    " ",
    "\0",
    "a/b",
    "*",
    "**",
    "../../../etc/passwd",
    "ä\u202e\u0301",
    "\ufffe\uffff",
    "\U0001f600" * 50,
    "<script>alert(1)</script>",
    "%s%n{0}${x}",
    "robot/",
    "camera/../x",
    "nan",
    "1e999",
    "-1",
    "x" * 64,
    "x" * 65,
    "x" * 5_000,
)
#: Odd lists and dictionaries have at most so many entries: memory is the sender's to fill up to the bus's limit, not ours.
_MANY = 200
_ODD_SHARES = (0.0, 0.01, 0.03, 0.03, 0.1, 0.4)

Maker = Callable[["Values", Any], Any]


class Values:
    """Draws values by a random generator.

    Attributes:
        random: where chance comes from; nothing else is random, so that an input can be made again by its number.
        odd: the share of values that are at a boundary of their type. ``begin`` draws it anew.
    """

    def __init__(self, random: Random) -> None:
        self.random, self.odd, self._now_ns = random, 0.0, time.time_ns()
        self.begin()

    def begin(self) -> None:
        """Chooses how odd the next message is."""
        self.odd = self.random.choice(_ODD_SHARES)

    def is_odd(self) -> bool:
        return self.random.random() < self.odd

    def of(self, kind: Any, sample: Any = None, name: str = "") -> Any:
        """A plain value of a type: like ``sample`` where there is one, or else a plausible one of that name."""
        return _maker(kind, name)(self, sample)

    def like(self, message: msgspec.Struct) -> Any:
        """A message's plain value, some of whose fields are varied."""
        return self.of(type(message), msgspec.to_builtins(message, builtin_types=(bytes,)))

    def bytes_like(self, data: bytes) -> bytes:
        """The bytes, or damaged ones: flipped bits, cut off, with more at the end, or others altogether."""
        if not self.is_odd() and self.random.random() < 0.7:
            return data
        kind, random = self.random.randrange(6), self.random
        if kind <= 2 and data:
            damaged = bytearray(data)
            for _ in range(random.choice((1, 1, 2, 8))):
                damaged[random.randrange(len(damaged))] ^= 1 << random.randrange(8)
            return bytes(damaged)
        if kind == 3:
            return data[: random.randrange(len(data) + 1)]
        if kind == 4:
            return data + random.randbytes(random.choice((1, 100)))
        return random.randbytes(random.choice((0, 1, 16, 1000)))

    def now_ns(self) -> int:
        """About the present, as a stamp."""
        return self._now_ns + self.random.randrange(-(10**9), 10**9)


@cache
def _maker(kind: Any, name: str) -> Maker:
    """How values of a type are drawn."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return _fields_maker(kind, {f.name: f.required for f in msgspec.structs.fields(kind)})
    if dataclasses.is_dataclass(kind):
        return _fields_maker(kind, {f.name: True for f in dataclasses.fields(kind)})
    if origin is typing.Literal:
        return lambda values, sample: _one_of(values, sample, arguments)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (a for a in arguments if a is not type(None))
        return lambda values, sample: _optional(values, sample, _maker(inner, name))
    if origin is list or (origin is tuple and arguments[-1] is ...):
        return lambda values, sample: _list(values, sample, _maker(arguments[0], name))
    if origin is tuple:
        makers = [_maker(a, name) for a in arguments]
        return lambda values, sample: [
            make(values, None if sample is None else sample[i]) for i, make in enumerate(makers)
        ]
    if origin is dict:
        key, value = _maker(arguments[0], name), _maker(arguments[1], "")
        return lambda values, sample: _dictionary(values, sample, key, value)
    if kind is Any:
        return lambda values, sample: sample
    return {int: _integer, float: _float, str: _text, bool: _bool, bytes: _bytes}[kind](name)


def _fields_maker(kind: Any, required: dict[str, bool]) -> Maker:
    hints = typing.get_type_hints(kind)
    makers = {name: (_maker(hints[name], name), is_required) for name, is_required in required.items()}

    def make(values: Values, sample: Any) -> dict[str, Any]:
        made = {}
        for name, (field, is_required) in makers.items():
            inner = sample.get(name) if sample is not None else None
            if inner is None and not is_required and (sample is not None or values.random.random() < 0.5):
                continue
            made[name] = field(values, inner)
        return made

    special = {"Pose": _pose, "Pinhole": _pinhole, "Grid": _grid}.get(kind.__name__)
    return make if special is None else lambda values, sample: make(values, sample or special(values))


def _pose(values: Values) -> dict[str, Any]:
    r = values.random
    turn = r.choice(((0.0, 0.0, 0.0, 1.0), (0.5, -0.5, 0.5, -0.5), (0.0, 0.0, 0.6, 0.8)))
    return {
        "translation_m": [r.uniform(0, 5), r.uniform(0, 4), r.choice((0.0, 0.88, 2.4, 3.5))],
        "quaternion_xyzw": list(turn),
    }


def _pinhole(values: Values) -> dict[str, Any]:
    return {"width_px": 32, "height_px": 24, "fx_px": 20.0, "fy_px": 20.0, "cx_px": 15.5, "cy_px": 11.5}


def _grid(values: Values) -> dict[str, Any]:
    return {"origin_x_m": -1.0, "origin_y_m": -1.0, "resolution_m": 0.25, "rows": 24, "cols": 24}


def _one_of(values: Values, sample: Any, allowed: tuple[Any, ...]) -> Any:
    if sample is not None and not values.is_odd():
        return sample
    return values.random.choice(allowed)


def _optional(values: Values, sample: Any, inner: Maker) -> Any:
    if sample is None and values.random.random() < 0.4:
        return None
    return None if values.is_odd() and values.random.random() < 0.5 else inner(values, sample)


def _list(values: Values, sample: Any, inner: Maker) -> list[Any]:
    if values.is_odd():
        one = inner(values, sample[0] if sample else None)
        return [one] * values.random.choice((0, 1, _MANY))
    if sample is not None:
        return [inner(values, item) for item in sample]
    return [inner(values, None) for _ in range(values.random.randrange(4))]


def _dictionary(values: Values, sample: Any, key: Maker, value: Maker) -> dict[Any, Any]:
    if values.is_odd():
        first, one = key(values, None), value(values, None)
        numbers = range(values.random.choice((0, 1, _MANY)))
        return {first: one} | dict.fromkeys(numbers if isinstance(first, int) else map(str, numbers), one)
    if sample is not None:
        return {k: value(values, v) for k, v in sample.items()}
    return {key(values, None): value(values, None) for _ in range(values.random.randrange(3))}


def _integer(name: str) -> Maker:
    def make(values: Values, sample: Any) -> int:
        if values.is_odd():
            return values.random.choice(_ODD_INTEGERS)
        if sample is not None:
            return int(sample)
        return values.now_ns() if name.endswith("_ns") else values.random.randrange(5)

    return make


def _float(name: str) -> Maker:
    def make(values: Values, sample: Any) -> float:
        if values.is_odd():
            return values.random.choice(_ODD_FLOATS)
        return float(sample) if sample is not None else values.random.random() * 4.0

    return make


def _text(name: str) -> Maker:
    known = NAMES.get(name)

    def make(values: Values, sample: Any) -> str:
        if values.is_odd():
            return values.random.choice(_ODD_TEXTS)
        if sample is not None:
            return str(sample)
        return values.random.choice(known) if known else values.random.choice(("", "a", "seven", "0"))

    return make


def _bool(name: str) -> Maker:
    def make(values: Values, sample: Any) -> bool:
        return values.random.random() < 0.5 if sample is None or values.is_odd() else bool(sample)

    return make


def _bytes(name: str) -> Maker:
    return lambda values, sample: values.bytes_like(sample if sample is not None else b"\x00\x3c" + bytes(14))
