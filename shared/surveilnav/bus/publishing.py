"""Publishing, and three ways to receive: the newest message of one key, of each key of a stream, or every message."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Generic

import zenoh

from surveilnav.bus.connection import CONGESTION, PRIORITY, Connection, M, Received, bus_errors, check_size, encoding_of
from surveilnav.bus.correlation import attach_request_id, bound_request_id
from surveilnav.bus.queries import Question
from surveilnav.bus.wire import encode
from surveilnav.contract import Stream
from surveilnav.messages.base import Message


class Publisher:
    """Publishes messages on one key. Check ``matched`` before rendering or encoding anything for it."""

    def __init__(self, connection: Connection, stream: Stream, key: str) -> None:
        self._connection, self._stream, self.key = connection, stream, key
        mime = "application/octet-stream" if stream.payload else "application/msgpack"
        self._publisher = connection.session_for(stream).declare_publisher(
            key,
            encoding=encoding_of(stream.message, mime),
            congestion_control=CONGESTION[stream.when_full],
            priority=PRIORITY[stream.priority],
            express=stream.priority == "control",
        )

    @property
    def matched(self) -> bool:
        """Whether anybody listens now. Raises BusError if the connection fails."""
        with bus_errors(self.key):
            return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]

    def put(self, message: Message, payload: bytes = b"") -> int:
        """Publishes a message, with a payload if the stream has one, and returns the bytes that were offered. Raises BusError if
        it can't be sent."""
        header = encode(message)
        if self._stream.payload:
            attachment = attach_request_id(header)
        else:
            payload, attachment = header, attach_request_id()
        check_size(self.key, attachment, payload)
        with bus_errors(self.key):
            self._publisher.put(payload, attachment=attachment or None)
        n_bytes = len(attachment) + len(payload) + len(self.key)
        self._connection.traffic.count(self.key, "offered", n_bytes)
        return n_bytes

    def close(self) -> None:
        self._publisher.undeclare()  # type: ignore[no-untyped-call]


class LatestMessage(Generic[M]):
    """The newest message of one key. Older ones are replaced before they are decoded, and counted."""

    def __init__(self, connection: Connection, stream: Stream, key: str) -> None:
        self._connection, self._stream = connection, stream
        self._sample: Any = None
        self._lock = threading.Lock()
        self._subscriber = connection.session_for(stream).declare_subscriber(key, self._on_sample)

    def _on_sample(self, sample: Any) -> None:
        with self._lock:
            old, self._sample = self._sample, sample
        if old is not None:
            key, attachment = str(old.key_expr), 0 if old.attachment is None else len(old.attachment)
            self._connection.traffic.count(key, "replaced", len(old.payload) + attachment + len(key))

    def poll(self) -> Received[M] | None:
        """The newest message since the last poll, or None."""
        with self._lock:
            sample, self._sample = self._sample, None
        return None if sample is None else self._connection.decode(self._stream, sample)

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


class Subscription(Generic[M]):
    """Calls ``on_message`` with every message of a key, on a thread of the bus: it must return fast."""

    def __init__(
        self, connection: Connection, stream: Stream, key: str, on_message: Callable[[Received[M]], None]
    ) -> None:
        def on_sample(sample: Any) -> None:
            if received := connection.decode(stream, sample):
                with bound_request_id(received.request_id):
                    on_message(received)

        self._subscriber = connection.session_for(stream).declare_subscriber(key, on_sample)

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


class Table(Generic[M]):
    """The newest message of each key of a stream, for small messages (status, info, load).

    Messages published before the table existed are queried, if the stream allows it.

    Args:
        key: the keys, usually with wildcards.
        capacity: limit on the number of keys, so that invented keys can't fill the memory.
        on_message: called with every published message, too, on a thread of the bus: it must return fast.
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
        self._subscriber = connection.session_for(stream).declare_subscriber(key, self._on_sample)
        if "query" in stream.kind:
            for received in Question(connection, stream, key).ask_all(1.0):
                self._store(received)

    def _on_sample(self, sample: Any) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._lock:
                self._rows.pop(str(sample.key_expr), None)
        elif received := self._connection.decode(self._stream, sample):
            self._store(received)
            if self._on_message is not None:
                with bound_request_id(received.request_id):
                    self._on_message(received)
        self._connection.wake.set()

    def _store(self, received: Received[M]) -> None:
        with self._lock:
            known = self._rows.get(received.key)
            if known is not None or len(self._rows) < self._capacity:
                if known is not None and self._stream.merge is not None:
                    received = replace(received, message=self._stream.merge(known.message, received.message))
                self._rows[received.key] = received
            else:
                self._connection.reject(f"{self._stream.name}: too many keys", received.key)

    def rows(self, max_age_s: float | None = None) -> list[Received[M]]:
        """All messages in the order of their keys; only those that arrived within ``max_age_s``, if given."""
        with self._lock:
            rows = [self._rows[key] for key in sorted(self._rows)]
        return rows if max_age_s is None else [r for r in rows if r.age_s <= max_age_s]

    def get(self, **ids: object) -> Received[M] | None:
        """The message whose key has these ids, or None."""
        wanted = {k: str(v) for k, v in ids.items()}
        for row in self.rows():
            if all(row.ids.get(k) == v for k, v in wanted.items()):
                return row
        return None

    def forget(self, field: str, id: str) -> None:
        """Drops the messages with the id ``id`` in a field of their keys, until they are published again."""
        with self._lock:
            self._rows = {key: row for key, row in self._rows.items() if row.ids.get(field) != id}

    def clear(self) -> None:
        """Drops all messages, until they are published again."""
        with self._lock:
            self._rows = {}

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]
