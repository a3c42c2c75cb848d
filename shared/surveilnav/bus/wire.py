"""Messages to bytes and back, with the schema checked: what can't be read is a ``WireError``, never a crash."""

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


class Unanswered(BusError):  # noqa: N818 - an answer, not a fault
    """A query without an answer: nobody is there, or (``timed_out``) who is there took too long."""

    def __init__(self, message: str, *, timed_out: bool = False) -> None:
        super().__init__(message)
        self.timed_out = timed_out


class Refused(BusError):  # noqa: N818
    """A query that was answered with an error; ``name`` is from the contract, ``retry_after_ms`` is ``ErrorReply``'s."""

    def __init__(self, name: str, message: str, retry_after_ms: int | None = None) -> None:
        super().__init__(message)
        self.name, self.retry_after_ms = name, retry_after_ms


def clock_ns() -> int:
    """Nanoseconds since the epoch: the stamp of everything sent."""
    return time.time_ns()


def encode(message: Message) -> bytes:
    """Plain MessagePack."""
    return _encoder.encode(message)


@cache
def _decoder(kind: type[Message]) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(kind)


def decode(kind: type[M], data: bytes, schema: str | None) -> M:
    """The message in ``data``.

    ``schema`` is what the sender put into the encoding ("surveilnav.Observation/1.0"); another minor version
    is read, another name or major version refused.

    Raises:
        WireError: wrong schema or version, or bytes that don't decode.
    """
    expected = schema_of(kind)
    name, _, version = (schema or "").partition("/")
    if name != expected.partition("/")[0] or version.partition(".")[0] != str(VERSION):
        raise WireError(f"expected schema {expected}, got {schema!r:.80}")
    try:
        return _decoder(kind).decode(data)  # type: ignore[no-any-return]
    except (msgspec.DecodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise WireError(f"expected a {kind.__name__}, got {len(data)} bytes that don't decode: {error}") from error
