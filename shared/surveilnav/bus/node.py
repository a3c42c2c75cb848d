"""A node: one process on the bus.

    with Node("fusion", "fusion", BusSettings()) as node:
        frames = node.latest(CAMERA_FRAME, floor="0", camera="c1", view=3)  # the newest message of one key
        infos = node.table(CAMERA_INFO)                                     # the newest message of each key
        node.serve(OBJECTS, answer, floor="0")                              # answers queries on a thread of its own
        node.run(step)                                                      # until SIGTERM

It combines ``publishing``, ``queries`` and ``presence`` on one ``connection``, and adds what a process needs: its loop, its
health file, its traffic reports.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import msgspec

import surveilnav
from surveilnav.bus.connection import Connection, Received
from surveilnav.bus.presence import Presence
from surveilnav.bus.publishing import LatestMessage, Publisher, Subscription, Table
from surveilnav.bus.queries import Answer, Handler, QueryServer, Question, RetryAfterMs
from surveilnav.bus.settings import BusSettings
from surveilnav.bus.tls import check_owner
from surveilnav.bus.traffic import ReportedRows, WireBytes, WireCounter
from surveilnav.bus.wire import clock_ns
from surveilnav.contract import TRAFFIC, Stream
from surveilnav.errors import BusError
from surveilnav.messages import TrafficReport
from surveilnav.messages.base import Message

#: A loop that hasn't turned for this long counts as hanging. Rendering a view that isn't cached takes a second or two.
_STALLED_S = 30.0
_MAX_PROBLEM_CHARS = 500
#: So many bytes that were sent or received are news, of which a traffic report is published.
_REPORT_BYTES = 32_000


class Node:
    """One process on the bus; see the module's docstring. Use it as a context manager.

    Args:
        kind: the kind of node that it announces itself as.
        id: the name under which it announces itself.
        settings: where the router is; None: from the environment.
        alive: False for a process that neither announces itself nor reports its traffic.
        waits_for_name: whether it waits while another process has its name; entering the context raises NameTakenError if the
            other keeps it.

    Attributes:
        stopping: set when the process ends.
        wake: set whenever something arrived that a loop may wait for.
        handover: where processes of this machine hand each other payloads.
        ready: whether the service can work; part of ``healthy``.
    """

    def __init__(
        self,
        kind: str,
        id: str,
        settings: BusSettings | None = None,
        *,
        alive: bool = True,
        waits_for_name: bool = True,
    ) -> None:
        self.kind, self.id = kind, id
        self.settings = settings or BusSettings()
        self.building = self.settings.building
        self._wire = WireCounter(self.settings.router_port)
        self._connection = Connection(f"{kind}/{id}", self.settings)
        self._presence = Presence(self._connection)
        self.log, self.traffic = self._connection.log, self._connection.traffic
        self.stopping = self._connection.stopping
        self.wake = self._connection.wake
        self.handover = self._connection.handover
        self.ready: Callable[[], bool] = lambda: True
        self._announces, self._waits_for_name = alive, waits_for_name
        self._problems: dict[str, str] = {}
        self._stepped_s: float | None = None

    # --- process --------------------------------------------------------------------------------------------------

    def __enter__(self) -> Node:
        self._connection.open()
        try:
            if self._announces:
                if self._connection.identity:
                    check_owner(self._connection.identity, self.kind, self.id)
                self._report_traffic()
                self._presence.announce(self.kind, self.id, waits=self._waits_for_name)
        except BaseException:  # also after SIGTERM: an open session would keep the process from ending
            self._connection.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._connection.close()

    def run(self, step: Callable[[], bool], idle_s: float = 0.005) -> None:
        """Calls ``step`` until SIGTERM or SIGINT. After a step that returned False, waits up to ``idle_s`` or for ``wake``."""
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
        """Ends ``run`` and everything that waits on ``stopping``."""
        self._connection.stop()

    def _report_traffic(self) -> None:
        name = f"{self.kind}-{self.id}"
        self._traffic_publisher = self.publisher(TRAFFIC, node=name)
        self.serve(TRAFFIC, lambda _: Answer(self.traffic_report()), node=name)
        self._connection.start_thread(self._housekeeping, "housekeeping")

    def _housekeeping(self) -> None:
        """Once a second: reports traffic if that is due, and touches the health file."""
        reported_problems: dict[str, str] = {}
        reported_bytes, reported_s, reported_rows = 0, 0.0, ReportedRows()
        while not self.stopping.wait(1.0):
            self.handover.remove_old()
            try:
                # A long report every second would itself be traffic. While little is sent, one is sent before the last is stale.
                n_bytes = sum(row.n_bytes for row in self.traffic.rows() if TRAFFIC.ids_of(row.key) is None)
                is_news = n_bytes - reported_bytes >= _REPORT_BYTES or self._problems != reported_problems
                due = is_news or time.monotonic() - reported_s >= TRAFFIC.max_age_ms / 2000
                if due and self._traffic_publisher.matched:
                    reported_problems, reported_bytes, reported_s = self._problems, n_bytes, time.monotonic()
                    report = self.traffic_report()
                    rows, is_partial = reported_rows.news(report.rows, reported_s)
                    self._traffic_publisher.put(msgspec.structs.replace(report, rows=rows, is_partial=is_partial))
                if self.settings.health_file and self.healthy():
                    self.settings.health_file.parent.mkdir(parents=True, exist_ok=True)
                    self.settings.health_file.touch()
                    os.utime(self.settings.health_file)
            except (BusError, OSError) as error:
                reported_rows = ReportedRows()  # what couldn't be published isn't known to anybody
                self.warn_seldom("housekeeping failed", error=str(error))

    def healthy(self) -> bool:
        """Whether the loop still turns, the session is open, and the service is ``ready``."""
        turning = self._stepped_s is None or time.monotonic() - self._stepped_s < _STALLED_S
        return turning and self._connection.is_open and self.ready()

    def traffic_report(self) -> TrafficReport:
        """What this process has published, received, dropped and sent over the network so far."""
        wire = self.wire_bytes()
        return TrafficReport(
            stamp_ns=clock_ns(),
            node=self.id,
            kind=self.kind,
            rows=self.traffic.rows(),
            tier_bytes=self.traffic.tier_bytes(),
            unsent=self.traffic.unsent(),
            rejected=self.traffic.rejected(),
            release=surveilnav.__version__,
            problems=self._problems,
            wire_sent_bytes=wire and wire.sent,
            wire_received_bytes=wire and wire.received,
        )

    def wire_bytes(self) -> WireBytes | None:
        """What the kernel has counted of this process's connection so far; None where it can't be asked."""
        return self._wire.read()

    # --- publishing -----------------------------------------------------------------------------------------------

    def key(self, stream: Stream, **ids: object) -> str:
        """The key of a stream in this node's building. Ids that are left out become wildcards."""
        return self._connection.key(stream, **ids)

    def publisher(self, stream: Stream, **ids: object) -> Publisher:
        return Publisher(self._connection, stream, self.key(stream, **ids))

    def latest(self, stream: Stream, **ids: object) -> LatestMessage[Any]:
        """Receives the newest message of one key."""
        return LatestMessage(self._connection, stream, self.key(stream, **ids))

    def table(
        self, stream: Stream, on_message: Callable[[Received[Any]], None] | None = None, **ids: object
    ) -> Table[Any]:
        """Receives the newest message of each matching key; ids left out match any. ``on_message``: as in ``subscribe``."""
        return Table(self._connection, stream, self.key(stream, **ids), on_message=on_message)

    def subscribe(
        self, stream: Stream, on_message: Callable[[Received[Any]], None], **ids: object
    ) -> Subscription[Any]:
        """Calls ``on_message`` with every message of the matching keys, on a thread of the bus: it must return fast."""
        return Subscription(self._connection, stream, self.key(stream, **ids), on_message)

    # --- queries --------------------------------------------------------------------------------------------------

    def serve(
        self,
        stream: Stream,
        handler: Handler,
        *,
        workers: int = 1,
        capacity: int = 16,
        retry_after_ms: RetryAfterMs = None,
        **ids: object,
    ) -> None:
        """Answers the queries to a key with ``handler``.

        Args:
            stream: which queries.
            handler: returns the answer, or a future of it. If the key has wildcards, an answer must have ``ids``. To answer
                with an error it raises ``Refused`` or another SurveilNavError.
            workers: number of threads that call the handler.
            capacity: number of queries that may wait; more are refused at once as "busy".
            retry_after_ms: hint for those: a number, or a function that returns it.
            ids: of the key; those that are left out become wildcards.
        """
        QueryServer(
            self._connection,
            stream,
            self.key(stream, **ids),
            handler,
            workers=workers,
            capacity=capacity,
            retry_after_ms=retry_after_ms,
        )

    def ask(
        self,
        stream: Stream,
        request: Message | None = None,
        *,
        payload: bytes = b"",
        timeout_s: float | None = None,
        parameters: dict[str, str] | None = None,
        **ids: object,
    ) -> Received[Any]:
        """Sends a query and returns its one answer. ``timeout_s``: None: as in the contract.

        Raises:
            Refused: the answer is an error.
            Unanswered: nobody serves the key, or (``timed_out``) not in time.
        """
        timeout_s = timeout_s if timeout_s is not None else stream.max_age_ms / 1000
        return Question(self._connection, stream, self.key(stream, **ids), request, payload, parameters).ask(timeout_s)

    def ask_all(
        self,
        stream: Stream,
        request: Message | None = None,
        *,
        timeout_s: float = 2.0,
        parameters: dict[str, str] | None = None,
        **ids: object,
    ) -> list[Received[Any]]:
        """Sends a query to all who serve the key, and returns the answers that arrive in time, without errors."""
        question = Question(self._connection, stream, self.key(stream, **ids), request, parameters=parameters)
        return question.ask_all(timeout_s)

    # --- presence -------------------------------------------------------------------------------------------------

    def alive(self, kind: str) -> set[str]:
        """Ids of the nodes of a kind that are present now. The first call for a kind subscribes to its changes."""
        return self._presence.alive(kind)

    def announce(self, kind: str, id: str) -> None:
        """Announces another node that this process stands for, until the process ends."""
        self._presence.announce(kind, id)

    def routers(self) -> int:
        """Number of routers that this node is connected to now."""
        return self._presence.routers()

    # --- warnings -------------------------------------------------------------------------------------------------

    def report_problem(self, what: str, why: str) -> None:
        """Has everybody know, by this node's traffic report, that it can't do something now. ``why``: for people; "": it can."""
        if self._problems.get(what, "") != why:
            self._problems = {k: v for k, v in {**self._problems, what: why[:_MAX_PROBLEM_CHARS]}.items() if v}

    def reject(self, where: str, why: str) -> None:
        """Counts remote data that was dropped, and logs it at a limited rate."""
        self._connection.reject(where, why)

    def warn_seldom(self, event: str, **facts: Any) -> None:
        """Logs a warning, at a limited rate for each event and ``where``."""
        self._connection.warn_seldom(event, **facts)

    def log_once(self, event: str, **facts: Any) -> None:
        """Logs an event the first time that it happens for the request of now, so that its id is found in this log."""
        self._connection.log_once(event, **facts)
