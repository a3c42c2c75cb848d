"""A message in an MCAP file: bytes on a topic, and the schema by which they are read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec
from google.protobuf.message import Message as FoxgloveMessage
from mcap_protobuf.schema import build_file_descriptor_set

from surveilnav.contract import STREAMS, Stream, schema_of
from surveilnav.services.recorder.core.bus_message import BusMessage

#: Encoding of messages that are in the file as they went over the bus.
BUS_ENCODING = "msgpack"


@dataclass(frozen=True, slots=True)
class Schema:
    """The schema of a topic's messages, as the file has it."""

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True, eq=False)
class McapMessage:
    """A message in a file. ``log_ns``: when the recorder received it; ``publish_ns``: its sender's time stamp."""

    topic: str
    encoding: str
    schema: Schema
    data: bytes
    log_ns: int
    publish_ns: int


def encode_bus_message(received: BusMessage) -> McapMessage:
    """A message of the bus on its own key: MessagePack, for streams with a payload the pair (message, payload)."""
    message, stream = received.message, received.stream
    data = msgspec.msgpack.encode((message, received.payload) if stream.payload else message)
    publish_ns = max(0, message.stamp_ns)
    return McapMessage(received.key, BUS_ENCODING, _bus_schema(stream), data, received.log_ns, publish_ns)


def decode_bus_message(stream: Stream, data: bytes) -> tuple[Any, bytes]:
    """The (message, payload) that ``encode_bus_message`` encoded. Raises msgspec.DecodeError if it is something else."""
    if stream.payload:
        message, payload = _decoder(stream).decode(data)
        return message, payload
    return _decoder(stream).decode(data), b""


def stream_of_topic(schema: str, topic: str) -> Stream | None:
    """The contract's stream of a topic with this schema; None: there is none."""
    name = schema.partition("/")[0]
    matching = (s for s in STREAMS if s.ids_of(topic) is not None)
    return next((s for s in matching if schema_of(s.message).partition("/")[0] == name), None)


def encode_foxglove(topic: str, message: FoxgloveMessage, log_ns: int, publish_ns: int) -> McapMessage:
    """A message that Foxglove and Lichtblick show."""
    kind: Any = type(message)
    return McapMessage(topic, "protobuf", _foxglove_schema(kind), message.SerializeToString(), log_ns, publish_ns)


@cache
def _bus_schema(stream: Stream) -> Schema:
    kind: Any = tuple[stream.message, bytes] if stream.payload else stream.message  # type: ignore[name-defined]
    return Schema(schema_of(stream.message), "jsonschema", msgspec.json.encode(msgspec.json.schema(kind)))


@cache
def _foxglove_schema(kind: type[FoxgloveMessage]) -> Schema:
    files = build_file_descriptor_set(kind)  # type: ignore[no-untyped-call]
    return Schema(kind.DESCRIPTOR.full_name, "protobuf", files.SerializeToString())


@cache
def _decoder(stream: Stream) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(tuple[stream.message, bytes] if stream.payload else stream.message)  # type: ignore[name-defined]
