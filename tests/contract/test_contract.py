"""The table: unique keys, messages that survive the wire, one page that says the same, no key anywhere else."""

from __future__ import annotations

import re
import typing
from pathlib import Path

import msgpack
import msgspec
import pytest

from surveilnav import contract, messages
from surveilnav.bus.wire import decode, encode
from surveilnav.contract import STREAMS, schema_of
from surveilnav.errors import WireError
from surveilnav.geometry import Grid, Pinhole, Pose
from surveilnav.messages.base import Message

ROOT = Path(__file__).parents[2]
MESSAGES = [v for v in vars(messages).values() if isinstance(v, type) and issubclass(v, Message)]


def example(kind: typing.Any) -> typing.Any:
    """A value of a type: what every field would look like, filled in."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Literal:
        return arguments[0]
    if origin is list:
        return [example(arguments[0])]
    if origin is dict:
        return {example(arguments[0]): example(arguments[1])}
    if origin is tuple:
        return (example(arguments[0]),) if arguments[-1] is ... else tuple(example(a) for a in arguments)
    if arguments and type(None) in arguments:
        return example(arguments[0])
    if kind is Pose:
        return Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))
    if kind is Pinhole:
        return Pinhole(640, 480, 388.0, 388.0, 319.5, 239.5)
    if kind is Grid:
        return Grid(-12.0, -12.0, 0.05, 480, 480)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        hints = typing.get_type_hints(kind)
        return kind(**{f.name: example(hints[f.name]) for f in msgspec.structs.fields(kind)})
    return {int: 7, float: 0.5, str: "seven", bool: True, bytes: b"\x07"}[kind]


def test_keys_are_unique_and_disjoint():
    keys = [s.key for s in STREAMS]
    assert len(set(keys)) == len(keys)
    for stream in STREAMS:
        concrete = stream.key_for(**{f: f"x{i}" for i, f in enumerate(stream.fields)})
        owners = [s.name for s in STREAMS if s.ids_of(concrete) is not None]
        assert owners == [stream.name]


@pytest.mark.parametrize("stream", STREAMS, ids=lambda s: s.name)
def test_a_key_gives_its_ids_back(stream):
    ids = {f: f"id-{i}" for i, f in enumerate(stream.fields)}
    assert stream.ids_of(stream.key_for(**ids)) == ids
    assert stream.ids_of(stream.key_for(**ids) + "/more") is None


@pytest.mark.parametrize("bad", ["a/b", "**", "", "a b", "$x", "ä", "x" * 65, "../x"])
def test_ids_that_would_break_a_key_are_refused(bad):
    with pytest.raises(ValueError, match="an id has letters"):
        contract.MISSION_GOAL.key_for(building="b", mission=bad)


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda k: k.__name__)
def test_messages_survive_the_wire_and_are_plain_messagepack(kind):
    message = example(kind)
    data = encode(message)
    assert decode(kind, data, schema_of(kind)) == message
    plain = msgpack.unpackb(data, strict_map_key=False)
    assert plain["stamp_ns"] == 7


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda k: k.__name__)
def test_other_schemas_and_broken_bytes_are_refused(kind):
    data = encode(example(kind))
    name = f"surveilnav.{kind.__name__}"
    assert decode(kind, data, f"{name}/1.9") == decode(kind, data, f"{name}/1.0")  # minor versions are read
    for schema in (f"{name}/2.0", "surveilnav.Other/1.0", "", None, "x" * 10_000):
        with pytest.raises(WireError, match="expected schema"):
            decode(kind, data, schema)
    for broken in (b"", data[:-1], b"\xff" * 40, b"\x81\xa1", msgpack.packb({"stamp_ns": "soon"})):
        with pytest.raises(WireError, match="don't decode"):
            decode(kind, broken, schema_of(kind))


def test_every_message_is_used_by_the_table_or_named_as_a_part():
    used = {s.message for s in STREAMS} | {s.request for s in STREAMS}
    assert {k.__name__ for k in MESSAGES} - {k.__name__ for k in used if k} <= {"ErrorReply"}


def test_the_page_is_generated_from_the_table():
    assert (ROOT / "docs/understand/contract.md").read_text() == contract.markdown(), "run: make docs"


def test_no_key_string_outside_the_table():
    pattern = re.compile(r"[\"'](@?surveilnav/\d|[^\"'\s]*/(frame|observation|infer|revision)/)")
    for folder in ("shared", "services", "cli", "benchmark"):
        for path in (ROOT / folder).rglob("*.py"):
            if path.name != "contract.py":
                assert not pattern.search(path.read_text()), path
