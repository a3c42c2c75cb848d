"""Puts and what receives them: publishers; the newest of one key, the newest of every key, or every message."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Generic

import zenoh

from surveilnav.bus.connection import CONGESTION, PRIORITY, Connection, M, Received, bus_errors, check_size, encoding_of
from surveilnav.bus.queries import ask_all
from surveilnav.bus.wire import encode
from surveilnav.contract import Stream
from surveilnav.messages.base import Message


class Publisher:
    """Puts messages on one key. ``matched`` says whether anybody listens: gate rendering and encoding on it."""

    def __init__(self, connection: Connection, stream: Stream, key: str) -> None:
        self._connection, self._stream, self.key = connection, stream, key
        mime = "application/octet-stream" if stream.payload else "application/msgpack"
        self._publisher = connection.session.declare_publisher(
            key,
            encoding=encoding_of(stream.message, mime),
            congestion_control=CONGESTION[stream.when_full],
            priority=PRIORITY[stream.priority],
            express=stream.priority == "control",
        )

    @property
    def matched(self) -> bool:
        """Whether anybody listens now. Raises BusError."""
        with bus_errors(self.key):
            return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]

    def put(self, message: Message, payload: bytes = b"") -> None:
        """Puts a message, with a payload where the stream has one. Raises BusError: it can't be sent."""
        header = encode(message)
        check_size(self.key, header, payload)
        with bus_errors(self.key):
            if self._stream.payload:
                self._publisher.put(payload, attachment=header)
            else:
                self._publisher.put(header)
        self._connection.traffic.count(self.key, "offered", len(header) + len(payload) + len(self.key))

    def close(self) -> None:
        """Withdraws the publisher."""
        self._publisher.undeclare()  # type: ignore[no-untyped-call]


class LatestMessage(Generic[M]):
    """The newest message of one key; older ones are overwritten before they cost anything."""

    def __init__(self, connection: Connection, stream: Stream, key: str) -> None:
        self._connection, self._stream = connection, stream
        self._subscriber = connection.session.declare_subscriber(key, zenoh.handlers.RingChannel(1))

    def poll(self) -> Received[M] | None:
        """The newest message since the last poll, or None."""
        sample = self._subscriber.try_recv()
        return None if sample is None else self._connection.received(self._stream, sample)

    def close(self) -> None:
        """Stops listening."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


class Subscription(Generic[M]):
    """Every message of a key, handed to ``on_message`` on the bus's own thread: for what is quickly put aside."""

    def __init__(
        self, connection: Connection, stream: Stream, key: str, on_message: Callable[[Received[M]], None]
    ) -> None:
        def on_sample(sample: Any) -> None:
            if received := connection.received(stream, sample):
                on_message(received)

        self._subscriber = connection.session.declare_subscriber(key, on_sample)

    def close(self) -> None:
        """Stops listening."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


class Table(Generic[M]):
    """The newest message of every key of a stream: for small messages (status, info, load).

    At most ``capacity`` keys are kept: a stranger who invents keys fills no memory. ``on_message`` gets every message
    that is put, too, on the bus's own thread: for what is quickly put aside.
    """

    def __init__(
        self,
        connection: Connection,
        stream: Stream,
        key: str,
        capacity: int = 20_000,
        on_message: Callable[[Received[M]], None] | None = None,
    ) -> None:
        self._connection, self._stream, self._capacity = connection, stream, capacity
        self._on_message = on_message
        self._rows: dict[str, Received[M]] = {}
        self._lock = threading.Lock()
        self._subscriber = connection.session.declare_subscriber(key, self._on_sample)
        if "query" in stream.kind:  # what was put before we came
            for received in ask_all(connection, stream, key, timeout_s=1.0):
                self._store(received)

    def _on_sample(self, sample: Any) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._lock:
                self._rows.pop(str(sample.key_expr), None)
        elif received := self._connection.received(self._stream, sample):
            self._store(received)
            if self._on_message is not None:
                self._on_message(received)
        self._connection.wake.set()

    def _store(self, received: Received[M]) -> None:
        with self._lock:
            if received.key in self._rows or len(self._rows) < self._capacity:
                self._rows[received.key] = received
            else:
                self._connection.reject(f"{self._stream.name}: too many keys", received.key)

    def rows(self, max_age_s: float | None = None) -> list[Received[M]]:
        """Everything known, by key; only what arrived within ``max_age_s`` if given."""
        with self._lock:
            rows = [self._rows[key] for key in sorted(self._rows)]
        return rows if max_age_s is None else [r for r in rows if r.age_s <= max_age_s]

    def get(self, **ids: object) -> Received[M] | None:
        """The row whose key has these ids, or None."""
        wanted = {k: str(v) for k, v in ids.items()}
        for row in self.rows():
            if all(row.ids.get(k) == v for k, v in wanted.items()):
                return row
        return None

    def forget(self, field: str, id: str) -> None:
        """Drops the rows of one owner, until it puts again."""
        with self._lock:
            self._rows = {key: row for key, row in self._rows.items() if row.ids.get(field) != id}

    def clear(self) -> None:
        """Drops all rows, until their owners put again."""
        with self._lock:
            self._rows = {}

    def close(self) -> None:
        """Stops listening."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]
