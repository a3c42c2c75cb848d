"""What the gateway remembers of the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from surveilnav import contract
from surveilnav.bus import Node, Received
from surveilnav.contract import Stream
from surveilnav.services.gateway.core.resources import ROOT

#: How long a list of what is put on change is believed before it is asked for again.
REFRESH_S = 5.0
_KINDS = ("camera", "robot", "perception", "fusion", "planner", "recorder", "replay")


class LastKnown:
    """The newest message of every key of a stream, also of owners that are gone.

    What is put on change may have been put before the gateway was there, or by an owner that came later than
    it: such streams are asked again every ``REFRESH_S``. That blocks for as long as an answer may take.
    """

    def __init__(self, node: Node, stream: Stream, capacity: int = 20_000) -> None:
        self._node, self._stream, self._capacity = node, stream, capacity
        #: Is handed every message that is put, on the bus's own thread.
        self.on_message: Callable[[Received[Any]], None] = lambda _: None
        self._table = node.table(stream, on_message=lambda row: self.on_message(row))
        self._asked: dict[str, Received[Any]] = {}
        self._asked_s = time.monotonic()
        self._lock, self._asking = threading.Lock(), threading.Lock()
        self._dropped = 0  # counts calls of ``forget`` and ``clear``

    def rows(self) -> list[Received[Any]]:
        """The newest row of every key, in the order of the keys."""
        merged = self._asked_rows()
        for row in self._table.rows():
            known = merged.get(row.key)
            if known is None or known.message.stamp_ns <= row.message.stamp_ns:
                merged[row.key] = row
        return [merged[key] for key in sorted(merged)]

    def _asked_rows(self) -> dict[str, Received[Any]]:
        # whoever comes while another asks takes what is known: an answer may take its time
        if self._stream.rate_hz is None and self._asking.acquire(blocking=False):
            try:
                self._ask_again()
            finally:
                self._asking.release()
        with self._lock:
            return dict(self._asked)

    def _ask_again(self) -> None:
        if time.monotonic() - self._asked_s <= REFRESH_S:
            return
        dropped = self._dropped
        answers = self._node.ask_all(self._stream, timeout_s=1.0)
        with self._lock:
            if dropped != self._dropped:
                return  # some of them may be what was dropped
            for row in answers:
                if row.key in self._asked or len(self._asked) < self._capacity:
                    self._asked[row.key] = row
            self._asked_s = time.monotonic()

    def newest(self, field: str) -> dict[str, Received[Any]]:
        """The newest row by one id of its key, in the order of the ids. A message that names another isn't believed."""
        found: dict[str, Received[Any]] = {}
        for row in sorted(self.rows(), key=lambda r: r.received_ns):
            if getattr(row.message, field) == row.ids[field]:
                found[row.ids[field]] = row
        return dict(sorted(found.items()))

    def forget(self, field: str, id: str) -> None:
        """Drops what is known of one owner; it comes back if that announces itself again."""
        with self._lock:
            self._dropped += 1
            for key in [k for k, row in self._asked.items() if row.ids[field] == id]:
                del self._asked[key]
        self._table.forget(field, id)

    def clear(self) -> None:
        """Drops everything: it lies in the future of a replay that was taken back."""
        with self._lock:
            self._asked, self._dropped = {}, self._dropped + 1
        self._table.clear()

    def old(self, row: Received[Any]) -> bool:
        """Whether a row came longer ago than the contract allows."""
        return row.age_s * 1000 > self._stream.max_age_ms


class BuildingState:
    """The streams that are remembered, and who is there. ``node`` asks for the rest.

    ``root``: where the addresses in answers begin; ``root_path``: where a proxy has the gateway, "" at the top.
    """

    def __init__(self, node: Node, root_path: str = "") -> None:
        self.node, self.root = node, root_path + ROOT
        self.missions = LastKnown(node, contract.MISSION_STATUS)
        self.plans = LastKnown(node, contract.MISSION_PLAN)
        self.judged = LastKnown(node, contract.JUDGED)
        self.cameras = LastKnown(node, contract.CAMERA_INFO)
        self.summaries = LastKnown(node, contract.CAMERA_SUMMARY)
        self.robots = LastKnown(node, contract.ROBOT_STATUS)
        self.loads = LastKnown(node, contract.PERCEPTION_LOAD)
        self.revisions = LastKnown(node, contract.MAP_REVISION)
        self.recorders = LastKnown(node, contract.RECORDER_STATUS)
        self.services = LastKnown(node, contract.SERVICES)
        self.traffic = LastKnown(node, contract.TRAFFIC)
        self.replays = LastKnown(node, contract.REPLAY)
        for kind in _KINDS:
            node.alive(kind)  # the first call starts watching

    def clear(self) -> None:
        """Forgets all that may be told again otherwise: everything but where the replay is."""
        for known in vars(self).values():
            if isinstance(known, LastKnown) and known is not self.replays:
                known.clear()

    def alive(self, kind: str) -> bool:
        """Whether any node of the kind is there."""
        return bool(self.node.alive(kind))
