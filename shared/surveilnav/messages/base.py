"""The base of all messages."""

from __future__ import annotations

import msgspec


class Message(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A message of the contract. ``stamp_ns``: time of the sender's clock, in nanoseconds since the epoch."""

    stamp_ns: int
