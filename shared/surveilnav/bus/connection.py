"""A process's connection to the router, which publishers, queries and presence share.

Whatever arrives is decoded and checked here, and its bytes are counted by key. Data that can't be decoded is counted
(``TrafficReport.rejected``), logged at a limited rate and dropped.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import structlog
import zenoh

from surveilnav.bus import wire
from surveilnav.bus.correlation import attached_request_id, bound_request_id, request_id
from surveilnav.bus.handover import HandoverFolder
from surveilnav.bus.logs import RateLimiter
from surveilnav.bus.settings import MAX_MESSAGE_BYTES, BusSettings, host_and_port
from surveilnav.bus.traffic import TrafficMeter
from surveilnav.bus.wire import clock_ns
from surveilnav.contract import Stream, schema_of
from surveilnav.errors import BusError, WireError
from surveilnav.messages.base import Message

M = TypeVar("M", bound=Message)
PRIORITY = {
    "control": zenoh.Priority.INTERACTIVE_HIGH,
    "data": zenoh.Priority.DATA_HIGH,
    "maps": zenoh.Priority.DATA,  # above bulk data: a query for a map is small and must not wait for frames
    "bulk": zenoh.Priority.DATA_LOW,
}
#: In an encoding, before the name of a payload in the ``HandoverFolder``.
_HANDED = ";handed="
#: "Leave out" is Zenoh's BLOCK_FIRST: at each link one message waits without blocking the sender, and those that come
#: meanwhile are dropped as a whole. Zenoh's DROP would send parts of a message before giving it up.
CONGESTION = {"wait": zenoh.CongestionControl.BLOCK, "leave out": zenoh.CongestionControl.BLOCK_FIRST}


@dataclass(frozen=True, slots=True)
class Received(Generic[M]):
    """A message that arrived.

    Attributes:
        key: its key expression.
        ids: the ids in the key, by field.
        message: the decoded message.
        payload: the raw bytes beside it; empty if the stream has none.
        received_ns: when it arrived, in nanoseconds since the epoch.
        request_id: the request that it belongs to (``bus.correlation``); "": none.
    """

    key: str
    ids: dict[str, str]
    message: M
    payload: bytes
    received_ns: int
    request_id: str = ""

    @property
    def age_s(self) -> float:
        return (clock_ns() - self.received_ns) / 1e9


class Connection:
    """The Zenoh sessions of a process, its traffic meter and logger, and the threads that must end before the sessions.

    There are two, so that maps and bulk data don't delay commands (7 ms instead of 92 ms). Zenoh could also use two links of one
    session, but mixes up keys then: a router that was frozen for longer than the lease takes the links that a process opens anew
    for more links of the session that it still has. It goes on with the numbers that this session had for keys, while the
    process has numbered them anew, so that messages arrive under the keys of others.

    Attributes:
        session: for control and data; ``bulk_session``: for maps and bulk data.
        stopping: set when the process ends.
        wake: set whenever something arrived that a loop may wait for.
        large_answer: held while waiting for an answer that may be left out; see ``queries.Question``.
        identity: the common name of this process's certificate; empty without security.
        handover: where processes of this machine hand each other payloads.
    """

    def __init__(self, name: str, settings: BusSettings) -> None:
        self.settings, self.building = settings, settings.building
        self.identity = ""
        self.log = structlog.get_logger().bind(node=name)
        self.traffic = TrafficMeter()
        self.stopping, self.wake = threading.Event(), threading.Event()
        self.large_answer = threading.Lock()
        self.handover = HandoverFolder(settings.handover_folder, settings.handover_mb << 20)
        self._log_limiter = RateLimiter()
        self._known_requests = RateLimiter(period_s=math.inf)
        self._threads: list[threading.Thread] = []
        self._declared: list[object] = []

    def open(self) -> None:
        """Connects to the router.

        Raises:
            BusError: no router answers in time, or it refuses this process's certificate.
            ConfigError: something is wrong with the files of this process's identity.
        """
        if self.settings.handover_folder and not self.handover.token:
            self.log.warning(
                "payloads are sent: the folder can't be used", handover_folder=str(self.settings.handover_folder)
            )
        files = self.settings.tls_files
        self.identity = files.check() if files else ""
        try:
            self.session = zenoh.open(zenoh.Config.from_json5(self.settings.client_config()))
            self.bulk_session = self._open_bulk_session()
        except zenoh.ZError as error:
            if files and (why := files.explain(*host_and_port(self.settings.router))):
                raise BusError(f"the router at {self.settings.router} can't be used: {why}") from None
            raise BusError(
                f"no router answers at {self.settings.router} (waited {self.settings.connect_timeout_s:g} s). "
                "Start one with `surveilnav up` or `python -m surveilnav.bus.router`, "
                "or point SURVEILNAV_BUS__ROUTER at the right tcp/HOST:PORT."
            ) from error

    def _open_bulk_session(self) -> zenoh.Session:
        try:
            return zenoh.open(zenoh.Config.from_json5(self.settings.client_config()))
        except BaseException:  # an open session would keep the process from ending
            self.session.close()  # type: ignore[no-untyped-call]
            raise

    def session_for(self, stream: Stream) -> zenoh.Session:
        """The session that a stream's messages and queries use."""
        return self.bulk_session if stream.priority in ("maps", "bulk") else self.session

    @property
    def is_open(self) -> bool:
        return not (self.session.is_closed() or self.bulk_session.is_closed())

    def close(self) -> None:
        """Ends the threads, then the sessions. May be called again."""
        self.stop()
        for thread in self._threads:  # they use the sessions
            thread.join(timeout=2.0)
        self.handover.close()
        for session in (self.bulk_session, self.session):
            if not session.is_closed():
                session.close()  # type: ignore[no-untyped-call]

    def stop(self) -> None:
        """Asks loops and threads to end."""
        self.stopping.set()
        self.wake.set()

    def start_thread(self, target: Callable[[], None], name: str) -> None:
        """Runs ``target`` on a thread of its own; it must return soon after ``stopping`` is set."""
        thread = threading.Thread(target=target, name=name, daemon=True)
        thread.start()
        self._threads.append(thread)

    def keep(self, declared: object) -> None:
        """Keeps a declared Zenoh object (such as a subscriber) until the connection is closed.

        Without a reference Python would garbage-collect it, and Zenoh would undeclare it.
        """
        self._declared.append(declared)

    def key(self, stream: Stream, **ids: object) -> str:
        """The key of a stream in this building. Ids that are left out become wildcards."""
        return stream.key_for(building=self.building, **ids)

    def decode(self, stream: Stream, sample: Any) -> Received[Any] | None:
        """Decodes a sample of Zenoh; None if it is no message of ``stream``, which is then counted and logged."""
        key = str(sample.key_expr)
        payload, attachment = bytes_of(sample.payload), bytes_of(sample.attachment)
        self.traffic.count(key, "delivered", len(payload) + len(attachment) + len(key))
        ids = stream.ids_of(key)
        try:
            if ids is None:
                raise WireError(f"expected a key like {stream.key}, got {key!r:.120}")
            data, raw = (attachment, payload) if stream.payload else (payload, b"")
            message = wire.decode(stream.message, data, schema_in(sample.encoding))
        except WireError as error:
            with bound_request_id(attached_request_id(attachment)):
                self.reject(stream.name, str(error))
            return None
        return Received(key, ids, message, raw, clock_ns(), attached_request_id(attachment))

    def reject(self, where: str, why: str) -> None:
        """Counts remote data that was dropped, and logs it at a limited rate."""
        count = self.traffic.reject(where)
        self.warn_seldom("dropped", where=where, why=why, count=count)

    def warn_seldom(self, event: str, **facts: Any) -> None:
        """Logs a warning, at a limited rate for each event and ``where``."""
        if self._log_limiter.try_acquire(event + str(facts.get("where", ""))):
            self.log.warning(event, **facts)

    def log_once(self, event: str, **facts: Any) -> None:
        """Logs an event the first time that it happens for the request of now, so that its id is found in this log."""
        if request_id() and self._known_requests.try_acquire(f"{event} {request_id()}"):
            self.log.info(event, **facts)

    def error_seldom(self, event: str, stream: str, error: Exception) -> None:
        """Logs an error with its traceback, at a limited rate for each event and stream."""
        if self._log_limiter.try_acquire(f"{event} {stream}"):
            self.log.error(event, stream=stream, exc_info=error)


@contextmanager
def bus_errors(key: str) -> Iterator[None]:
    """Turns Zenoh's exceptions into ``BusError``: nothing above the bus knows Zenoh's types."""
    try:
        yield
    except zenoh.ZError as error:
        raise BusError(f"the connection failed at {key}: {error}") from error


def check_size(key: str, *parts: bytes) -> None:
    """Raises BusError for a message that is so large that the router would drop it silently."""
    if (n_bytes := sum(map(len, parts))) > MAX_MESSAGE_BYTES:
        limit = f"{MAX_MESSAGE_BYTES / 2**20:g} MiB"
        raise BusError(
            f"a message may have up to {limit}, got {n_bytes / 2**20:.1f} MiB for {key}. Send less at a time."
        )


def bytes_of(data: Any) -> bytes:
    """The bytes of a payload or an attachment; empty if there is none."""
    return data.to_bytes() if data is not None else b""


def encoding_of(message: type[Message], mime: str = "application/msgpack", handed: str = "") -> zenoh.Encoding:
    """The Zenoh encoding for a message of this type: a MIME type and the message's schema. ``handed``: the name under which its
    payload lies in the ``HandoverFolder``."""
    return zenoh.Encoding(mime).with_schema(schema_of(message) + (_HANDED + handed if handed else ""))


def schema_in(encoding: Any) -> str:
    """The schema in a Zenoh encoding, which stands after a semicolon; empty if there is none."""
    return str(encoding).partition(";")[2].partition(_HANDED)[0] if encoding is not None else ""


def handed_in(encoding: Any) -> str:
    """The name under which a message's payload lies in the ``HandoverFolder``; empty if it came with the message."""
    return str(encoding).partition(_HANDED)[2] if encoding is not None else ""
