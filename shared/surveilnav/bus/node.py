"""A node: one process on the bus.

    with Node("fusion", "fusion", BusSettings()) as node:
        frames = node.slot(CAMERA_FRAME, floor="0", camera="c1", view=3)   # newest only
        infos = node.table(CAMERA_INFO)                                    # newest of every key
        node.serve(OBJECTS, answer, floor="0")                             # bounded queue, own thread
        node.run(step)                                                     # until SIGTERM

Everything received is decoded and checked here; what doesn't decode is counted (``TrafficReport.rejected``),
logged at a limited rate and dropped. Everything sent and received is metered by key.
"""

from __future__ import annotations

import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Generic, TypeVar, cast
from urllib.parse import quote, unquote

import structlog
import zenoh

from surveilnav.bus import logs
from surveilnav.bus.settings import BusSettings
from surveilnav.bus.traffic import TrafficMeter, wire_bytes
from surveilnav.bus.wire import Refused, Unanswered, clock_ns, decode, encode
from surveilnav.contract import LIVELINESS, TRAFFIC, Stream, schema_of
from surveilnav.errors import BusError, SurveilNavError, WireError
from surveilnav.messages import ErrorReply, TrafficReport
from surveilnav.messages.base import Message

M = TypeVar("M", bound=Message)
_PRIORITY = {
    "control": zenoh.Priority.INTERACTIVE_HIGH,
    "data": zenoh.Priority.DATA_HIGH,
    "bulk": zenoh.Priority.DATA_LOW,
}
#: A loop that hasn't turned for so long hangs; rendering an uncached view takes a second or two.
_STALLED_S = 30.0
#: A slot of a queryable that nobody could free: an honest error beats a silent wait.
BUSY = "busy"


@dataclass(frozen=True, slots=True)
class Received(Generic[M]):
    """One message as it arrived: its key, the ids in the key, the message, the raw payload, and when."""

    key: str
    ids: dict[str, str]
    message: M
    payload: bytes
    received_ns: int

    @property
    def age_s(self) -> float:
        """Seconds since it arrived."""
        return (clock_ns() - self.received_ns) / 1e9


@dataclass(frozen=True, slots=True)
class Request:
    """A query to answer: the ids in its key, its parameters, its message (None if it carries none), its payload."""

    ids: dict[str, str]
    parameters: dict[str, str]
    message: Any
    payload: bytes
    received_ns: int


@dataclass(frozen=True, slots=True)
class Answer:
    """A reply: the message, raw bytes beside it, and (for keys with wildcards asked) the ids of its own key."""

    message: Message
    payload: bytes = b""
    ids: dict[str, str] = field(default_factory=dict)


class Publisher:
    """Puts messages on one key. ``matched`` says whether anybody listens: gate rendering and encoding on it."""

    def __init__(self, node: Node, stream: Stream, key: str) -> None:
        self._node, self._stream, self.key = node, stream, key
        encoding = zenoh.Encoding("application/octet-stream" if stream.payload else "application/msgpack")
        self._publisher = node.session.declare_publisher(
            key,
            encoding=encoding.with_schema(stream.schema),
            # Default dropping sends fragments and then abandons the frame: block, and keep only the newest before it.
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=_PRIORITY[stream.priority],
            express=stream.priority == "control",
        )

    @property
    def matched(self) -> bool:
        return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]

    def put(self, message: Message, payload: bytes = b"") -> None:
        header = encode(message)
        if self._stream.payload:
            self._publisher.put(payload, attachment=header)
        else:
            self._publisher.put(header)
        self._node.traffic.count(self.key, "offered", len(header) + len(payload) + len(self.key))

    def close(self) -> None:
        self._publisher.undeclare()  # type: ignore[no-untyped-call]


class Slot(Generic[M]):
    """The newest message of one key; older ones are overwritten before they cost anything."""

    def __init__(self, node: Node, stream: Stream, key: str) -> None:
        self._node, self._stream = node, stream
        self._subscriber = node.session.declare_subscriber(key, zenoh.handlers.RingChannel(1))

    def poll(self) -> Received[M] | None:
        """The newest message since the last poll, or None."""
        sample = self._subscriber.try_recv()
        return None if sample is None else self._node.received(self._stream, sample)

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


class Table(Generic[M]):
    """The newest message of every key of a stream: for small messages (status, info, load).

    At most ``capacity`` keys are kept: a stranger who invents keys fills no memory.
    """

    def __init__(self, node: Node, stream: Stream, key: str, capacity: int = 20_000) -> None:
        self._node, self._stream, self._capacity = node, stream, capacity
        self._rows: dict[str, Received[M]] = {}
        self._lock = threading.Lock()
        self._subscriber = node.session.declare_subscriber(key, self._on_sample)
        if "query" in stream.kind:  # what was put before we came
            for received in node.ask_all(stream, key=key, timeout_s=1.0):
                self._store(cast("Received[M]", received))

    def _on_sample(self, sample: Any) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._lock:
                self._rows.pop(str(sample.key_expr), None)
        elif received := self._node.received(self._stream, sample):
            self._store(received)
        self._node.wake.set()

    def _store(self, received: Received[M]) -> None:
        with self._lock:
            if received.key in self._rows or len(self._rows) < self._capacity:
                self._rows[received.key] = received
            else:
                self._node.reject(f"{self._stream.name}: too many keys", received.key)

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

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def _schema(encoding: Any) -> str:
    """The schema in an encoding: Zenoh writes it after a semicolon."""
    return str(encoding).partition(";")[2] if encoding is not None else ""


def _parameters(query: Any) -> dict[str, str]:
    pairs = (part.partition("=") for part in str(query.parameters).split(";") if part)
    return {unquote(name): unquote(value) for name, _, value in pairs}


class Node:
    """One process on the bus: see the module's docstring. Use it as a context manager."""

    def __init__(self, kind: str, id: str, settings: BusSettings | None = None, *, alive: bool = True) -> None:
        self.kind, self.id = kind, id
        self.settings = settings or BusSettings()
        self.building = self.settings.building
        self.log = structlog.get_logger().bind(node=f"{kind}/{id}")
        self.traffic = TrafficMeter()
        self.stopping = threading.Event()
        #: Set whenever something arrived that a loop may wait for.
        self.wake = threading.Event()
        self.ready: Callable[[], bool] = lambda: True
        self._stepped_s: float | None = None
        self._limit = logs.RateLimit()
        self._declare_alive = alive
        self._threads: list[threading.Thread] = []
        self._watchers: dict[str, _Watcher] = {}
        self._stack = ExitStack()

    # --- life -----------------------------------------------------------------------------------------------------

    def __enter__(self) -> Node:
        if hasattr(self, "session"):  # entered already: a lease hands its node over
            return self
        try:
            self.session = zenoh.open(zenoh.Config.from_json5(self.settings.client_config()))
        except zenoh.ZError as error:
            raise BusError(
                f"no router answers at {self.settings.router} (waited {self.settings.connect_timeout_s:g} s). "
                "Start one with `surveilnav up` or `python -m surveilnav.bus.router`, "
                "or point SURVEILNAV_BUS__ROUTER at the right tcp/HOST:PORT."
            ) from error
        self._stack.enter_context(self.session)
        if self._declare_alive:
            token = LIVELINESS.format(building=self.building, kind=self.kind, id=self.id)
            self._token = self.session.liveliness().declare_token(token)  # dropped means undeclared: keep it
            self._traffic_publisher = self.publisher(TRAFFIC, node=f"{self.kind}-{self.id}")
            self.serve(TRAFFIC, lambda _: Answer(self.traffic_report()), node=f"{self.kind}-{self.id}")
            self._thread(self._housekeeping, "housekeeping")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.stopping.set()
        self.wake.set()
        for thread in self._threads:  # they use the session
            thread.join(timeout=2.0)
        self._stack.close()

    def run(self, step: Callable[[], bool], idle_s: float = 0.005) -> None:
        """Calls ``step`` until SIGTERM or SIGINT; waits up to ``idle_s`` after a step that had nothing to do."""
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda *_: self.stop())
        self.log.info("running", building=self.building, router=self.settings.router)
        while not self.stopping.is_set():
            self._stepped_s = time.monotonic()
            if not step():
                self.wake.wait(idle_s)
                self.wake.clear()
        self.log.info("stopped")

    def stop(self) -> None:
        self.stopping.set()
        self.wake.set()

    def _thread(self, target: Callable[[], None], name: str) -> None:
        thread = threading.Thread(target=target, name=name, daemon=True)
        thread.start()
        self._threads.append(thread)

    def _housekeeping(self) -> None:
        said: object = None
        said_s = 0.0
        while not self.stopping.wait(1.0):
            try:
                # A report of many rows every second would itself be traffic: only when there is news, else seldom.
                news = [row for row in self.traffic.rows() if row.key != self._traffic_publisher.key]
                due = news != said or time.monotonic() - said_s >= TRAFFIC.max_age_ms / 2000
                if due and self._traffic_publisher.matched:
                    said, said_s = news, time.monotonic()
                    self._traffic_publisher.put(self.traffic_report())
                if self.settings.health_file and self.healthy():
                    self.settings.health_file.parent.mkdir(parents=True, exist_ok=True)
                    self.settings.health_file.touch()
                    os.utime(self.settings.health_file)
            except (zenoh.ZError, OSError) as error:
                self.warn_seldom("housekeeping failed", error=str(error))

    def healthy(self) -> bool:
        """Whether the loop still turns and the service says that it can work: a process that hangs isn't healthy."""
        turning = self._stepped_s is None or time.monotonic() - self._stepped_s < _STALLED_S
        return turning and not self.session.is_closed() and self.ready()

    def traffic_report(self) -> TrafficReport:
        wire = wire_bytes(self.settings.router_port)
        return TrafficReport(
            stamp_ns=clock_ns(), node=self.id, kind=self.kind, rows=self.traffic.rows(), rejected=self.traffic.rejected(),
            wire_sent_bytes=wire and wire[0], wire_received_bytes=wire and wire[1],
        )  # fmt: skip

    # --- puts -----------------------------------------------------------------------------------------------------

    def key(self, stream: Stream, **ids: object) -> str:
        return stream.key_for(building=self.building, **ids)

    def publisher(self, stream: Stream, **ids: object) -> Publisher:
        return Publisher(self, stream, self.key(stream, **ids))

    def slot(self, stream: Stream, **ids: object) -> Slot[Any]:
        """The newest message of one concrete key."""
        return Slot(self, stream, self.key(stream, **ids))

    def table(self, stream: Stream, **ids: object) -> Table[Any]:
        """The newest message of every key that matches; fields left out are wildcards."""
        return Table(self, stream, self.key(stream, **ids))

    def received(self, stream: Stream, sample: Any) -> Received[Any] | None:
        """Decodes a sample; None (counted, logged seldom) if it is no message of ``stream``."""
        key = str(sample.key_expr)
        payload = sample.payload.to_bytes()
        attachment = sample.attachment.to_bytes() if sample.attachment is not None else b""
        self.traffic.count(key, "delivered", len(payload) + len(attachment) + len(key))
        ids = stream.ids_of(key)
        try:
            if ids is None:
                raise WireError(f"expected a key like {stream.key}, got {key!r:.120}")
            data, raw = (attachment, payload) if stream.payload else (payload, b"")
            message = decode(stream.message, data, _schema(sample.encoding))
        except WireError as error:
            self.reject(stream.name, str(error))
            return None
        return Received(key, ids, message, raw, clock_ns())

    # --- queries --------------------------------------------------------------------------------------------------

    def serve(
        self, stream: Stream, handler: Callable[[Request], Answer | list[Answer]], *, workers: int = 1, capacity: int = 16,
        **ids: object,
    ) -> None:  # fmt: skip
        """Answers queries to a key (wildcards allowed) with ``handler``, on ``workers`` threads of their own.

        A handler raises ``Refused`` (or any SurveilNavError) to answer with an error. When ``capacity`` queries
        wait, more are refused at once as "busy". If the key has wildcards, answers must name their ids.
        """
        own_key = self.key(stream, **ids)
        waiting: queue.Queue[Any] = queue.Queue(maxsize=capacity)

        def on_query(query: Any) -> None:
            try:
                waiting.put_nowait((query, clock_ns()))
            except queue.Full:
                self._refuse(query, BUSY, f"{capacity} queries are waiting already: ask again later or ask another")

        def work() -> None:
            while not self.stopping.is_set():
                try:
                    query, received_ns = waiting.get(timeout=0.2)
                except queue.Empty:
                    continue
                self._answer(stream, own_key, query, received_ns, handler)

        queryable = self.session.declare_queryable(own_key, on_query)
        self._stack.callback(lambda: queryable)  # keeps the reference
        for i in range(workers):
            self._thread(work, f"serve-{stream.name}-{i}")

    def _answer(
        self, stream: Stream, own_key: str, query: Any, received_ns: int,
        handler: Callable[[Request], Answer | list[Answer]],
    ) -> None:  # fmt: skip
        key = str(query.key_expr)
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            attachment = query.attachment.to_bytes() if query.attachment is not None else b""
            self.traffic.count(key, "delivered", len(payload) + len(attachment) + len(key))
            message = None
            if stream.request is not None and (attachment or payload):
                data, payload = (attachment, payload) if attachment else (payload, b"")
                message = decode(stream.request, data, _schema(query.encoding))
            elif stream.request is not None:
                raise WireError(f"expected a {stream.request.__name__}, got a query without a payload")
            ids = stream.ids_of(key) or {}
            if stream.kind == "query" and stream.request is not None and not ids:
                raise WireError(f"expected a key like {stream.key} without wildcards, got {key!r:.120}")
            answers = handler(Request(ids, _parameters(query), message, payload, received_ns))
            for answer in answers if isinstance(answers, list) else [answers]:
                reply_key = (
                    key if "*" not in key else (own_key if "*" not in own_key else self.key(stream, **answer.ids))
                )
                self._reply(stream, query, reply_key, answer)
        except WireError as error:
            self.reject(stream.name, str(error))
            self._refuse(query, "bad_message", str(error))
        except Refused as error:
            self._refuse(query, error.name, str(error))
        except SurveilNavError as error:
            self._refuse(query, "failed", str(error))
        except zenoh.ZError as error:
            self.warn_seldom("reply failed", stream=stream.name, error=str(error))
        except Exception as error:  # a handler's bug must not end the service, nor stay silent
            if self._limit.allows(f"query failed {stream.name}"):
                self.log.exception("query failed", stream=stream.name)
            self._refuse(query, "internal", f"{type(error).__name__}: {error}")
        finally:
            query.drop()  # a query kept alive stalls its caller until the timeout

    def _reply(self, stream: Stream, query: Any, key: str, answer: Answer) -> None:
        header = encode(answer.message)
        options: dict[str, Any] = {
            "encoding": zenoh.Encoding("application/msgpack").with_schema(schema_of(type(answer.message))),
        }  # priority and congestion control are the query's
        if stream.payload:
            query.reply(key, answer.payload, attachment=header, **options)
        else:
            query.reply(key, header, **options)
        self.traffic.count(key, "offered", len(header) + len(answer.payload) + len(key))

    def _refuse(self, query: Any, name: str, message: str) -> None:
        error = ErrorReply(stamp_ns=clock_ns(), name=name, message=message)
        try:
            query.reply_err(
                encode(error), encoding=zenoh.Encoding("application/msgpack").with_schema(schema_of(ErrorReply))
            )
        except zenoh.ZError as failure:
            self.warn_seldom("refusal failed", error=str(failure))
        finally:
            query.drop()

    def ask(
        self, stream: Stream, request: Message | None = None, *, payload: bytes = b"", timeout_s: float | None = None,
        parameters: dict[str, str] | None = None, **ids: object,
    ) -> Received[Any]:  # fmt: skip
        """The one answer to a query.

        Raises:
            Refused: the other side answered with an error.
            Unanswered: nobody answers there, or not in time.
        """
        key = self.key(stream, **ids)
        timeout_s = timeout_s if timeout_s is not None else stream.max_age_ms / 1000
        refused: Refused | None = None
        timed_out = False
        for reply in self._get(stream, key, request, payload, timeout_s, parameters):
            if reply.ok is not None:
                if received := self.received(stream, reply.ok):
                    return received
            elif (refused := self._error(reply.err)) is None:
                timed_out = True
        if refused:
            raise refused
        why = f"not within {timeout_s:g} s" if timed_out else "nobody is there"
        raise Unanswered(f"no answer from {key}: {why}", timed_out=timed_out)

    def ask_all(
        self, stream: Stream, request: Message | None = None, *, key: str | None = None, timeout_s: float = 2.0,
        parameters: dict[str, str] | None = None, **ids: object,
    ) -> list[Received[Any]]:  # fmt: skip
        """All answers that come within ``timeout_s``; errors are left out."""
        key = key or self.key(stream, **ids)
        replies = self._get(stream, key, request, b"", timeout_s, parameters)
        answers = [self.received(stream, reply.ok) for reply in replies if reply.ok is not None]
        return [answer for answer in answers if answer is not None]

    def _get(
        self, stream: Stream, key: str, request: Message | None, payload: bytes, timeout_s: float,
        parameters: dict[str, str] | None,
    ) -> Iterator[Any]:  # fmt: skip
        options: dict[str, Any] = {}
        header = b""
        if request is not None:
            header = encode(request)
            schema = schema_of(type(request))
            options["encoding"] = zenoh.Encoding("application/msgpack").with_schema(schema)
            if payload:
                options |= {"payload": payload, "attachment": header}
            else:
                options["payload"] = header
        selector: Any = key
        if parameters:
            selector = f"{key}?" + ";".join(f"{quote(k)}={quote(v)}" for k, v in parameters.items())
        self.traffic.count(key, "offered", len(header) + len(payload) + len(key))
        yield from self.session.get(
            selector, timeout=timeout_s, consolidation=zenoh.ConsolidationMode.NONE,
            priority=_PRIORITY[stream.priority], congestion_control=zenoh.CongestionControl.BLOCK, **options,
        )  # fmt: skip

    def _error(self, err: Any) -> Refused | None:
        """The refusal in an error reply; None for Zenoh's own timeout."""
        data = err.payload.to_bytes()
        try:
            error = decode(ErrorReply, data, _schema(err.encoding))
        except WireError:
            return None
        return Refused(error.name, error.message)

    # --- presence -------------------------------------------------------------------------------------------------

    def alive(self, kind: str) -> set[str]:
        """Ids of the nodes of a kind that are here now. The first call starts watching."""
        watcher = self._watchers.get(kind)
        if watcher is None:
            watcher = self._watchers[kind] = _Watcher(self, kind)
        return watcher.ids()

    # --- complaints -----------------------------------------------------------------------------------------------

    def reject(self, where: str, why: str) -> None:
        """Counts and (seldom) logs remote data that was dropped."""
        count = self.traffic.reject(where)
        self.warn_seldom("dropped", where=where, why=why, count=count)

    def warn_seldom(self, event: str, **facts: Any) -> None:
        if self._limit.allows(event + str(facts.get("where", ""))):
            self.log.warning(event, **facts)


class _Watcher:
    """Keeps the set of living ids of one kind."""

    def __init__(self, node: Node, kind: str) -> None:
        self._node = node
        self._ids: set[str] = set()
        self._lock = threading.Lock()
        pattern = LIVELINESS.format(building=node.building, kind=kind, id="*")
        self._subscriber = node.session.liveliness().declare_subscriber(pattern, self._on_change, history=True)
        for reply in node.session.liveliness().get(pattern, timeout=1.0):
            if reply.ok is not None:
                self._on_change(reply.ok)

    def _on_change(self, sample: Any) -> None:
        id = str(sample.key_expr).rsplit("/", 1)[1]
        with self._lock:
            (self._ids.add if sample.kind == zenoh.SampleKind.PUT else self._ids.discard)(id)
        self._node.wake.set()

    def ids(self) -> set[str]:
        with self._lock:
            return set(self._ids)
