"""One line of a recording: bytes on a topic, and the schema that says how they are read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec
from google.protobuf.message import Message as Drawn
from mcap_protobuf.schema import build_file_descriptor_set

from surveilnav.contract import STREAMS, Stream, schema_of
from surveilnav.messages.base import Message

#: Of what stands in a file as it went over the bus.
BUS_ENCODING = "msgpack"


@dataclass(frozen=True, slots=True)
class Schema:
    """How a file says what a topic's messages are."""

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """``log_ns``: when the recorder had it. ``publish_ns``: what its sender says of when it was."""

    topic: str
    encoding: str
    schema: Schema
    data: bytes
    log_ns: int
    publish_ns: int


def bus_line(stream: Stream, key: str, message: Message, payload: bytes, log_ns: int) -> Line:
    """A message of the bus: MessagePack, and for streams with a payload the pair of both, on its own key."""
    data = msgspec.msgpack.encode((message, payload) if stream.payload else message)
    return Line(key, BUS_ENCODING, _bus_schema(stream), data, log_ns, max(0, message.stamp_ns))


def read_bus_line(stream: Stream, data: bytes) -> tuple[Any, bytes]:
    """(message, payload) of what ``bus_line`` made. msgspec.DecodeError: it is something else."""
    if stream.payload:
        message, payload = _decoder(stream).decode(data)
        return message, payload
    return _decoder(stream).decode(data), b""


def stream_of(schema: str, topic: str) -> Stream | None:
    """Which row of the contract a topic with that schema is of; None: none."""
    named = schema.partition("/")[0]
    of_key = (s for s in STREAMS if s.ids_of(topic) is not None)
    return next((s for s in of_key if schema_of(s.message).partition("/")[0] == named), None)


def drawn_line(topic: str, message: Drawn, log_ns: int, publish_ns: int) -> Line:
    """A message that Foxglove and Lichtblick draw."""
    kind: Any = type(message)
    return Line(topic, "protobuf", _drawn_schema(kind), message.SerializeToString(), log_ns, publish_ns)


@cache
def _bus_schema(stream: Stream) -> Schema:
    kind: Any = tuple[stream.message, bytes] if stream.payload else stream.message  # type: ignore[name-defined]
    return Schema(schema_of(stream.message), "jsonschema", msgspec.json.encode(msgspec.json.schema(kind)))


@cache
def _drawn_schema(kind: type[Drawn]) -> Schema:
    files = build_file_descriptor_set(kind)  # type: ignore[no-untyped-call]
    return Schema(kind.DESCRIPTOR.full_name, "protobuf", files.SerializeToString())


@cache
def _decoder(stream: Stream) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(tuple[stream.message, bytes] if stream.payload else stream.message)  # type: ignore[name-defined]
