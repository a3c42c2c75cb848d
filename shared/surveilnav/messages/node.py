"""Messages that any node may send."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from surveilnav.messages.base import Message


class Ack(Message, frozen=True, kw_only=True):
    """Confirms a request. ``message``: what was done."""

    message: str = ""


class ErrorReply(Message, frozen=True, kw_only=True):
    """Why a query has no answer.

    Attributes:
        name: a name from the contract, for programs.
        message: a description for people.
        retry_after_ms: when the same query may be answered; None: never, or nobody knows.
    """

    name: str
    message: str
    retry_after_ms: int | None = None


class ServiceState(msgspec.Struct, frozen=True):
    """A process that a supervisor keeps running.

    Attributes:
        running: whether it runs, or else waits for its next start.
        restarts: number of restarts so far.
        restarted_ns: time of the last one; 0: never.
        why: how the process had ended, such as "SIGKILL" or "exit code 1".
        given_up: whether it won't be started any more.
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


#: A number that every reader can hold.
Count = Annotated[int, msgspec.Meta(ge=0, le=2**62)]
#: Of one node, at most.
_MAX_ROWS = 50_000


#: What frames of a camera wait for.
WaitReason = Literal["budget", "link"]


class TrafficRow(msgspec.Struct, frozen=True):
    """Messages and bytes of one key at one node since the node started.

    ``direction``: "replaced": they arrived, and a newer message of their key came before the node looked.
    """

    key: str
    direction: Literal["offered", "delivered", "replaced"]
    messages: Count
    n_bytes: Count


class TrafficReport(Message, frozen=True, kw_only=True):
    """Traffic of a node.

    Attributes:
        rows: bytes offered, delivered and replaced, by key.
        is_partial: whether ``rows`` are only those that have changed since the last report that was published (``merged``).
        tier_bytes: of a camera's offered frames, by tier.
        unsent: how many frames of a camera were never sent, because a newer picture of their view came while they waited: by
            what they waited for.
        wire_sent_bytes, wire_received_bytes: the kernel's count on the node's sockets; None: unknown.
        rejected: how often received data was dropped, by reason.
        release: the version of SurveilNav that the node runs; empty: it is so old that it doesn't say.
        problems: what the node can't do now, and why, for people: {"store": "the disk is full"}.
    """

    node: str
    kind: str
    rows: list[TrafficRow]
    is_partial: bool = False
    tier_bytes: dict[str, Count] = {}
    unsent: dict[str, Count] = {}
    wire_sent_bytes: int | None = None
    wire_received_bytes: int | None = None
    rejected: dict[str, int] = {}
    release: str = ""
    problems: dict[str, str] = {}

    def merged(self, later: TrafficReport) -> TrafficReport:
        """All that is known by this report and a ``later`` one of the same node."""
        if not later.is_partial:
            return later
        rows = {(row.key, row.direction): row for row in (*self.rows, *later.rows)}
        if len(rows) > _MAX_ROWS:
            return later  # no node has so many: somebody invents keys
        return msgspec.structs.replace(later, rows=list(rows.values()), is_partial=self.is_partial)
