"""A node: one process on the bus.

    with Node("fusion", "fusion", BusSettings()) as node:
        frames = node.latest(CAMERA_FRAME, floor="0", camera="c1", view=3)   # newest only
        infos = node.table(CAMERA_INFO)                                    # newest of every key
        node.serve(OBJECTS, answer, floor="0")                             # bounded queue, own thread
        node.run(step)                                                     # until SIGTERM

It puts ``publishing``, ``queries`` and ``presence`` together on one ``connection``, and adds the process's life:
its loop, its health, its traffic reports.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from surveilnav.bus import queries
from surveilnav.bus.connection import Connection, Received
from surveilnav.bus.presence import Presence
from surveilnav.bus.publishing import LatestMessage, Publisher, Subscription, Table
from surveilnav.bus.queries import Answer, Handler, QueryServer, RetryAfterMs
from surveilnav.bus.settings import BusSettings
from surveilnav.bus.traffic import wire_bytes
from surveilnav.bus.wire import clock_ns
from surveilnav.contract import TRAFFIC, Stream
from surveilnav.errors import BusError
from surveilnav.messages import TrafficReport
from surveilnav.messages.base import Message

#: A loop that hasn't turned for so long hangs; rendering an uncached view takes a second or two.
_STALLED_S = 30.0


class Node:
    """One process on the bus: see the module's docstring. Use it as a context manager.

    ``alive=False``: it doesn't announce itself, nor report its traffic.
    """

    def __init__(self, kind: str, id: str, settings: BusSettings | None = None, *, alive: bool = True) -> None:
        self.kind, self.id = kind, id
        self.settings = settings or BusSettings()
        self.building = self.settings.building
        self._connection = Connection(f"{kind}/{id}", self.settings)
        self._presence = Presence(self._connection)
        self.log, self.traffic = self._connection.log, self._connection.traffic
        self.stopping = self._connection.stopping
        #: Set whenever something arrived that a loop may wait for.
        self.wake = self._connection.wake
        #: Whether the service can work, for ``healthy``.
        self.ready: Callable[[], bool] = lambda: True
        self._announces = alive
        self._stepped_s: float | None = None

    # --- life -----------------------------------------------------------------------------------------------------

    def __enter__(self) -> Node:
        self._connection.open()
        try:
            if self._announces:
                self._report_traffic()
                self._presence.announce(self.kind, self.id)
        except BaseException:  # a SIGTERM too: a session left open would keep the process from ending
            self._connection.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._connection.close()

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
        """Ends ``run`` and everything that waits on ``stopping``."""
        self._connection.stop()

    def _report_traffic(self) -> None:
        name = f"{self.kind}-{self.id}"
        self._traffic_publisher = self.publisher(TRAFFIC, node=name)
        self.serve(TRAFFIC, lambda _: Answer(self.traffic_report()), node=name)
        self._connection.thread(self._housekeeping, "housekeeping")

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
            except (BusError, OSError) as error:
                self.warn_seldom("housekeeping failed", error=str(error))

    def healthy(self) -> bool:
        """Whether the loop still turns and the service says that it can work: a process that hangs isn't healthy."""
        turning = self._stepped_s is None or time.monotonic() - self._stepped_s < _STALLED_S
        return turning and not self._connection.session.is_closed() and self.ready()

    def traffic_report(self) -> TrafficReport:
        """What this process offered, received, dropped and sent over the wire so far."""
        wire = wire_bytes(self.settings.router_port)
        return TrafficReport(
            stamp_ns=clock_ns(),
            node=self.id,
            kind=self.kind,
            rows=self.traffic.rows(),
            rejected=self.traffic.rejected(),
            wire_sent_bytes=wire and wire[0],
            wire_received_bytes=wire and wire[1],
        )

    # --- puts -----------------------------------------------------------------------------------------------------

    def key(self, stream: Stream, **ids: object) -> str:
        """The key of a stream in this node's building; ids left out are wildcards."""
        return self._connection.key(stream, **ids)

    def publisher(self, stream: Stream, **ids: object) -> Publisher:
        """What puts messages on one concrete key."""
        return Publisher(self._connection, stream, self.key(stream, **ids))

    def latest(self, stream: Stream, **ids: object) -> LatestMessage[Any]:
        """The newest message of one concrete key."""
        return LatestMessage(self._connection, stream, self.key(stream, **ids))

    def table(
        self, stream: Stream, on_message: Callable[[Received[Any]], None] | None = None, **ids: object
    ) -> Table[Any]:
        """The newest message of every key that matches; fields left out are wildcards. ``on_message``: as ``subscribe``."""
        return Table(self._connection, stream, self.key(stream, **ids), on_message=on_message)

    def subscribe(
        self, stream: Stream, on_message: Callable[[Received[Any]], None], **ids: object
    ) -> Subscription[Any]:
        """Hands every message that matches to ``on_message``, on the bus's own thread."""
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
        """Answers queries to a key (wildcards allowed) with ``handler``, on ``workers`` threads of their own.

        A handler raises ``Refused`` (or any SurveilNavError) to answer with an error. When ``capacity`` queries
        wait, more are refused at once as "busy", and told ``retry_after_ms``: a number, or what gives it. A handler may
        return a future, to answer later. If the key has wildcards, answers must name their ids.
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
        """The one answer to a query, within ``timeout_s`` or the time that the contract gives.

        Raises:
            Refused: the other side answered with an error.
            Unanswered: nobody answers there, or (``timed_out``) not in time.
        """
        timeout_s = timeout_s if timeout_s is not None else stream.max_age_ms / 1000
        return queries.ask(
            self._connection,
            stream,
            self.key(stream, **ids),
            request,
            payload=payload,
            timeout_s=timeout_s,
            parameters=parameters,
        )

    def ask_all(
        self,
        stream: Stream,
        request: Message | None = None,
        *,
        timeout_s: float = 2.0,
        parameters: dict[str, str] | None = None,
        **ids: object,
    ) -> list[Received[Any]]:
        """All answers that come within ``timeout_s``; errors are left out."""
        key = self.key(stream, **ids)
        return queries.ask_all(self._connection, stream, key, request, timeout_s=timeout_s, parameters=parameters)

    # --- presence -------------------------------------------------------------------------------------------------

    def alive(self, kind: str) -> set[str]:
        """Ids of the nodes of a kind that are here now. The first call starts watching."""
        return self._presence.alive(kind)

    def announce(self, kind: str, id: str) -> None:
        """Says that a node is there for which this process speaks, until it ends."""
        self._presence.announce(kind, id)

    def routers(self) -> int:
        """How many routers this node is connected to now."""
        return self._presence.routers()

    # --- complaints -----------------------------------------------------------------------------------------------

    def reject(self, where: str, why: str) -> None:
        """Counts and (seldom) logs remote data that was dropped."""
        self._connection.reject(where, why)

    def warn_seldom(self, event: str, **facts: Any) -> None:
        """Logs a warning, at a limited rate for each event and place."""
        self._connection.warn_seldom(event, **facts)
