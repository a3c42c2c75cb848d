"""A node without a bus, for services that are fed by the fuzzer.

It decodes as ``bus.connection`` does; what the fuzzer delivers lands in the tables and slots of the service, or in its handlers.
"""

from __future__ import annotations

import threading
from collections import Counter, defaultdict
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import msgspec
import structlog

from surveilnav.bus import Answer, Received, Request, Unanswered, clock_ns
from surveilnav.bus.handover import HandoverFolder
from surveilnav.bus.wire import decode, encode
from surveilnav.contract import Stream, schema_of
from surveilnav.errors import WireError

BUILDING = "test"


class UnexpectedError(AssertionError):
    """A service caught an exception that nothing should have raised."""


class _Stopping(threading.Event):
    """An event that nobody waits for: pauses take no time."""

    def wait(self, timeout: float | None = None) -> bool:
        return self.is_set() if threading.current_thread() is threading.main_thread() else super().wait(timeout)


class _Slot:
    """The newest message of one key."""

    def __init__(self) -> None:
        self.message: Received[Any] | None = None

    def poll(self) -> Received[Any] | None:
        message, self.message = self.message, None
        return message

    def close(self) -> None:
        pass


class _Table:
    def __init__(self, on_message: Callable[[Received[Any]], None] | None) -> None:
        self._rows: dict[str, Received[Any]] = {}
        self._on_message = on_message

    def store(self, received: Received[Any]) -> None:
        self._rows[received.key] = received
        if self._on_message is not None:
            self._on_message(received)

    def rows(self, max_age_s: float | None = None) -> list[Received[Any]]:
        return [self._rows[key] for key in sorted(self._rows)]

    def get(self, **ids: object) -> Received[Any] | None:
        wanted = {k: str(v) for k, v in ids.items()}
        return next((r for r in self.rows() if all(r.ids.get(k) == v for k, v in wanted.items())), None)

    def forget(self, field: str, id: str) -> None:
        self._rows = {key: row for key, row in self._rows.items() if row.ids.get(field) != id}

    def clear(self) -> None:
        self._rows = {}

    def close(self) -> None:
        pass


class FedNode:
    """Stands in for ``bus.Node``.

    Attributes:
        answer: called by ``ask``: (stream, request) to what is answered; raises what the bus would.
        handlers: what the service serves, by the stream's name.
        rejected: how often the service dropped something, by reason.
    """

    id, building = "f1", BUILDING

    def __init__(self) -> None:
        self.stopping, self.wake = _Stopping(), threading.Event()
        self.handover = HandoverFolder(None, 0)
        self.log = structlog.wrap_logger(None, processors=[self._hear])
        self.handlers: dict[str, tuple[Stream, Callable[[Request], Any]]] = {}
        self.answer: Callable[[Stream, Any], Received[Any]] = self._nobody
        self.rejected: Counter[str] = Counter()
        self.present: dict[str, set[str]] = defaultdict(set)
        self.traffic = SimpleNamespace(rows=list, count_frame=lambda tier, n_bytes: None)
        self._tables: dict[str, list[_Table]] = defaultdict(list)
        self._slots: dict[str, _Slot] = {}

    def _hear(self, _: Any, method: str, event: Any) -> Any:
        if event.get("exc_info"):
            raise UnexpectedError(event["event"])
        raise structlog.DropEvent

    @staticmethod
    def _nobody(stream: Stream, request: Any) -> Received[Any]:
        raise Unanswered(f"nobody serves {stream.name}")

    # --- what services use ----------------------------------------------------------------------------------------

    def key(self, stream: Stream, **ids: object) -> str:
        return stream.key_for(building=BUILDING, **ids)

    def serve(self, stream: Stream, handler: Callable[[Request], Any], **options: Any) -> None:
        self.handlers[stream.name] = stream, handler

    def table(self, stream: Stream, on_message: Callable[[Received[Any]], None] | None = None, **ids: object) -> Any:
        self._tables[stream.name].append(table := _Table(on_message))
        return table

    def subscribe(self, stream: Stream, on_message: Callable[[Received[Any]], None], **ids: object) -> Any:
        return self.table(stream, on_message)

    def latest(self, stream: Stream, **ids: object) -> Any:
        return self._slots.setdefault(self.key(stream, **ids), _Slot())

    def publisher(self, stream: Stream, **ids: object) -> Any:
        key = self.key(stream, **ids)

        def put(message: Any, payload: bytes = b"") -> None:
            encode(message)  # what can't be encoded would end the service

        return SimpleNamespace(put=put, matched=True, key=key, close=lambda: None)

    def ask(self, stream: Stream, request: Any = None, **options: Any) -> Received[Any]:
        return self.answer(stream, request)

    def ask_all(self, stream: Stream, request: Any = None, **options: Any) -> list[Received[Any]]:
        try:
            return [self.answer(stream, request)]
        except (Unanswered, WireError):
            return []

    def alive(self, kind: str) -> set[str]:
        return self.present[kind]

    def announce(self, kind: str, id: str) -> None:
        pass

    def routers(self) -> int:
        return 1

    def wire_bytes(self) -> None:
        return None

    def report_problem(self, what: str, why: str) -> None:
        pass

    def reject(self, where: str, why: str) -> None:
        self.rejected[where] += 1

    def warn_seldom(self, event: str, **facts: Any) -> None:
        if event == "a view could not be perceived" or "exc_info" in facts:
            raise UnexpectedError(f"{event}: {facts}")
        self.rejected[event] += 1

    # --- what the fuzzer uses -------------------------------------------------------------------------------------

    def deliver(self, stream: Stream, plain: Any, payload: bytes = b"", **ids: str) -> Received[Any]:
        """Has a message arrive on the key with these ids. Raises WireError where its schema refuses it."""
        received = received_of(stream, plain, payload, **ids)
        for table in self._tables[stream.name]:
            table.store(received)
        if received.key in self._slots:
            self._slots[received.key].message = received
        return received

    def query(self, name: str, plain: Any, payload: bytes, parameters: dict[str, str], **ids: str) -> list[Answer]:
        """Has a query arrive. Its answers are encoded, as the bus would."""
        stream, handler = self.handlers[name]
        message = None if stream.request is None else decoded(stream.request, plain)
        answers = handler(Request(ids, parameters, message, payload, clock_ns()))
        answers = answers if isinstance(answers, list) else [answers]
        for answer in answers:
            encode(answer.message)
        return answers


def decoded(kind: Any, plain: Any) -> Any:
    """A plain value as a message of a type, by way of bytes. Raises WireError."""
    return decode(kind, msgspec.msgpack.encode(plain), schema_of(kind))


def received_of(stream: Stream, plain: Any, payload: bytes = b"", **ids: str) -> Received[Any]:
    """A plain value as it arrives on a key. Raises WireError."""
    message = decoded(stream.message, plain)
    named = {"building": BUILDING, **ids}
    return Received(stream.key_for(**named), named, message, payload, clock_ns())
