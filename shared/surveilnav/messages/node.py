"""What every node says of itself."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.messages.base import Message


class Ack(Message, frozen=True, kw_only=True):
    """A plain yes, with a word about what was done."""

    message: str = ""


class ErrorReply(Message, frozen=True, kw_only=True):
    """Why a query wasn't answered: a name from the contract and a text for people.

    ``retry_after_ms``: when the same query may be answered; None: nobody knows, or never.
    """

    name: str
    message: str
    retry_after_ms: int | None = None


class ServiceState(msgspec.Struct, frozen=True):
    """A process that somebody keeps running.

    ``running``: it isn't waiting for its next start. ``restarts``: how often it was started again, ``restarted_ns`` the last
    time (0: never). ``why``: how it had ended, such as "SIGKILL" or "exit code 1". ``given_up``: it isn't started any more.
    """

    name: str
    running: bool
    restarts: int = 0
    restarted_ns: int = 0
    why: str = ""
    given_up: bool = False


class ServiceList(Message, frozen=True, kw_only=True):
    """All processes that ``supervisor`` keeps running."""

    supervisor: str
    services: list[ServiceState]


class TrafficRow(msgspec.Struct, frozen=True):
    """Bytes and messages of one key expression at one node since it started."""

    key: str
    direction: Literal["offered", "delivered"]
    messages: int
    n_bytes: int


class TrafficReport(Message, frozen=True, kw_only=True):
    """The three numbers of a node. ``wire_*``: the kernel's count on this node's own sockets (None: unknown)."""

    node: str
    kind: str
    rows: list[TrafficRow]
    wire_sent_bytes: int | None = None
    wire_received_bytes: int | None = None
    rejected: dict[str, int] = {}
