"""Encodes and decodes messages, and checks their schema. Data that can't be decoded raises ``WireError``, never anything else."""

from __future__ import annotations

import time
from functools import cache
from typing import Any, TypeVar

import msgspec

from surveilnav.contract import VERSION, schema_of
from surveilnav.errors import BusError, WireError
from surveilnav.messages.base import Message

M = TypeVar("M", bound=Message)
_encoder = msgspec.msgpack.Encoder()


class Unanswered(BusError):  # noqa: N818 - an outcome, not a fault
    """A query without an answer: nobody serves the key, or (``timed_out``) the answer took too long."""

    def __init__(self, message: str, *, timed_out: bool = False) -> None:
        super().__init__(message)
        self.timed_out = timed_out


class Refused(BusError):  # noqa: N818
    """A query that was answered with an error. ``name``, ``retry_after_ms``: see ``ErrorReply``."""

    def __init__(self, name: str, message: str, retry_after_ms: int | None = None) -> None:
        super().__init__(message)
        self.name, self.retry_after_ms = name, retry_after_ms


def clock_ns() -> int:
    """The present time for ``stamp_ns``: nanoseconds since the epoch."""
    return time.time_ns()


def encode(message: Message) -> bytes:
    """The message as MessagePack."""
    return _encoder.encode(message)


@cache
def _decoder(kind: type[Message]) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(kind)


def decode(kind: type[M], data: bytes, schema: str | None) -> M:
    """Decodes a message of type ``kind``.

    Args:
        schema: the sender's schema from the encoding, such as "surveilnav.Observation/1.0". Another minor version is
            accepted.

    Raises:
        WireError: the schema has another name or major version, or the bytes can't be decoded.
    """
    expected = schema_of(kind)
    name, _, version = (schema or "").partition("/")
    if name != expected.partition("/")[0] or version.partition(".")[0] != str(VERSION):
        raise WireError(f"expected schema {expected}, got {schema!r:.80}")
    try:
        return _decoder(kind).decode(data)  # type: ignore[no-any-return]
    except (msgspec.DecodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise WireError(f"expected a {kind.__name__}, got {len(data)} bytes that don't decode: {error}") from error
