"""A message of the bus, on its way into recordings."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.contract import Stream
from surveilnav.messages.base import Message


@dataclass(frozen=True, slots=True, eq=False)
class BusMessage:
    """A message of the bus with its key and payload. ``log_ns``: when the recorder received it."""

    stream: Stream
    key: str
    message: Message
    payload: bytes
    log_ns: int
