"""Remembers the newest messages of the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from surveilnav import contract
from surveilnav.bus import Node, Received
from surveilnav.contract import Stream
from surveilnav.rest import ROOT

#: Streams whose messages are only published on change are queried again after this time.
REFRESH_S = 5.0
_COMPLETE_REFRESH_S = 60.0
_KINDS = ("camera", "robot", "perception", "fusion", "planner", "recorder", "replay")


class LastKnown:
    """The newest message of every key of a stream, also of nodes that have left.

    The gateway misses a message that is only published on change if it was published before the gateway started, or by a node
    that the gateway hadn't noticed yet. So such streams, and those whose caller ``asks``, are also queried, every ``REFRESH_S``,
    by the first caller after that time; its call blocks until the answers are there. With ``publishers``, the kind of node
    that the stream comes from, this is done once a minute only while each node of that kind has said something since it came.
    """

    def __init__(self, node: Node, stream: Stream, capacity: int = 20_000, publishers: str = "") -> None:
        self._node, self._stream, self._capacity, self._publishers = node, stream, capacity, publishers
        #: Called with every published message, on the bus's own thread.
        self.on_message: Callable[[Received[Any]], None] = lambda _: None
        self._table = node.table(stream, on_message=lambda row: self.on_message(row))
        self._answers: dict[str, Received[Any]] = {}
        self._present: set[str] = set()  # publishers, when it was last looked
        self._unheard: set[str] = set()  # publishers that have come since the last query
        self._refreshed_s = time.monotonic()
        self._lock, self._refreshing = threading.Lock(), threading.Lock()
        self._n_removals = 0  # counts the calls of ``forget`` and ``clear``

    def rows(self, *, asks: bool = False) -> list[Received[Any]]:
        """The newest row of every key, in the order of the keys. ``asks``: the stream is queried, too, if that is due."""
        merged = self._refreshed_answers(asks or self._stream.rate_hz is None)
        for row in self._table.rows():
            known = merged.get(row.key)
            if known is None or known.message.stamp_ns <= row.message.stamp_ns:
                if known is not None and self._stream.merge is not None:
                    row = replace(row, message=self._stream.merge(known.message, row.message))
                merged[row.key] = row
        return [merged[key] for key in sorted(merged)]

    def _refreshed_answers(self, asks: bool) -> dict[str, Received[Any]]:
        # while another caller refreshes, this one doesn't wait but returns what is known
        if asks and self._refreshing.acquire(blocking=False):
            try:
                self._refresh()
            finally:
                self._refreshing.release()
        with self._lock:
            return dict(self._answers)

    def _refresh(self) -> None:
        if time.monotonic() - self._refreshed_s <= (_COMPLETE_REFRESH_S if self._is_complete() else REFRESH_S):
            return
        n_removals = self._n_removals
        answers = self._node.ask_all(self._stream, timeout_s=1.0)
        with self._lock:
            if n_removals != self._n_removals:
                return  # some of the answers may be what was removed meanwhile
            for row in answers:
                if row.key in self._answers or len(self._answers) < self._capacity:
                    self._answers[row.key] = row
            self._refreshed_s = time.monotonic()
            self._unheard -= {row.ids[self._publishers] for row in answers} if self._publishers else set()

    def _is_complete(self) -> bool:
        """Whether every publisher that is present has said something since it came."""
        if not self._publishers:
            return False
        present = self._node.alive(self._publishers)
        with self._lock:
            known = {row.ids[self._publishers] for row in self._answers.values()}
            self._unheard = (self._unheard | (present - self._present)) & present
            self._present = present
            return not self._unheard and present <= known | {row.ids[self._publishers] for row in self._table.rows()}

    def newest(self, field: str) -> dict[str, Received[Any]]:
        """The newest row for each id in ``field`` of the key, sorted by id. Messages that name another id are ignored."""
        found: dict[str, Received[Any]] = {}
        for row in sorted(self.rows(), key=lambda r: r.received_ns):
            if getattr(row.message, field) == row.ids[field]:
                found[row.ids[field]] = row
        return dict(sorted(found.items()))

    def forget(self, field: str, id: str) -> None:
        """Removes what is known of one node, such as a camera. It is known again as soon as it publishes again."""
        with self._lock:
            self._n_removals += 1
            for key in [k for k, row in self._answers.items() if row.ids[field] == id]:
                del self._answers[key]
        self._table.forget(field, id)

    def clear(self) -> None:
        """Removes everything, because a replay jumped and it may be from that replay's future."""
        with self._lock:
            self._answers, self._n_removals = {}, self._n_removals + 1
        self._table.clear()

    def is_old(self, row: Received[Any]) -> bool:
        """Whether a row arrived longer ago than the contract allows."""
        return row.age_s * 1000 > self._stream.max_age_ms


class BuildingState:
    """The newest messages of the streams that the gateway needs, and which nodes are alive.

    Attributes:
        root: the beginning of addresses in answers: the path at which a proxy serves the gateway, if any, and /api/v1.
    """

    def __init__(self, node: Node, root_path: str = "") -> None:
        self.node, self.root = node, root_path + ROOT
        self.missions = LastKnown(node, contract.MISSION_STATUS)
        self.plans = LastKnown(node, contract.MISSION_PLAN)
        self.judged = LastKnown(node, contract.JUDGED)
        self.cameras = LastKnown(node, contract.CAMERA_INFO, publishers="camera")
        self.summaries = LastKnown(node, contract.CAMERA_SUMMARY)
        self.robots = LastKnown(node, contract.ROBOT_STATUS)
        self.loads = LastKnown(node, contract.PERCEPTION_LOAD)
        self.revisions = LastKnown(node, contract.MAP_REVISION)
        self.areas = LastKnown(node, contract.FLOOR_AREAS)
        self.removals = LastKnown(node, contract.MAP_REMOVALS)
        self.recorders = LastKnown(node, contract.RECORDER_STATUS)
        self.services = LastKnown(node, contract.SERVICES)
        self.traffic = LastKnown(node, contract.TRAFFIC)
        self.replays = LastKnown(node, contract.REPLAY)
        for kind in _KINDS:
            node.alive(kind)  # the first call starts watching

    def clear(self) -> None:
        """Removes everything but the status of the replay itself, after a replay has jumped."""
        for known in vars(self).values():
            if isinstance(known, LastKnown) and known is not self.replays:
                known.clear()

    def alive(self, kind: str) -> bool:
        return bool(self.node.alive(kind))
