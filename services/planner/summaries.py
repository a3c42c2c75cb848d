"""What the cameras of all floors last reported, checked and grouped by floor. The planner chooses the floor by it."""

from __future__ import annotations

import msgspec

from surveilnav.bus import Node, Received
from surveilnav.contract import CAMERA_SUMMARY
from surveilnav.messages import CameraSummary

_LIMIT_BYTES = 512
_MAX_LABEL_CHARS = 64
_MAX_AGE_S = CAMERA_SUMMARY.max_age_ms / 1000


class Summaries:
    """The fresh summaries. Each invalid one is dropped, counted (``TrafficReport.rejected``) and logged once."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._table = node.table(CAMERA_SUMMARY)
        self._checked: dict[str, tuple[int, bool]] = {}  # key -> when the newest arrived, and whether it is valid

    def by_floor(self) -> dict[str, dict[str, float]]:
        """Floor -> label -> the highest confidence that a camera of that floor last reported.

        A floor whose cameras saw nothing has no labels. A floor without fresh summaries is missing.
        """
        floors: dict[str, dict[str, float]] = {}
        for row in self._valid():
            labels = floors.setdefault(row.ids["floor"], {})
            for label, confidence in row.message.labels.items():
                labels[label] = max(confidence, labels.get(label, 0.0))
        return floors

    def received_bytes(self) -> dict[str, int]:
        """Bytes (payload and key) of all summaries received so far, by floor."""
        floor_of = {row.key: row.ids["floor"] for row in self._table.rows()}
        received = dict.fromkeys(sorted(set(floor_of.values())), 0)
        for count in self._node.traffic.rows():
            if count.direction == "delivered" and count.key in floor_of:
                received[floor_of[count.key]] += count.n_bytes
        return received

    def fresh_bytes(self) -> int:
        """Bytes (payload and key) of the fresh summaries, on which a choice made now is based."""
        return sum(len(msgspec.msgpack.encode(row.message)) + len(row.key) for row in self._valid())

    def _valid(self) -> list[Received[CameraSummary]]:
        rows = self._table.rows(max_age_s=_MAX_AGE_S)
        return [row for row in rows if self._is_valid(row)]

    def _is_valid(self, row: Received[CameraSummary]) -> bool:
        received_ns, is_valid = self._checked.get(row.key, (0, False))
        if received_ns != row.received_ns:
            fault = fault_of(row.ids, row.message)
            is_valid = not fault
            self._checked[row.key] = row.received_ns, is_valid
            if fault:
                self._node.reject(CAMERA_SUMMARY.name, f"{row.key}: {fault}")
        return is_valid


def fault_of(ids: dict[str, str], message: CameraSummary) -> str:
    """What is wrong with a summary that arrived on the key with these ids; empty if nothing is."""
    said = {"floor": message.floor, "camera": message.camera}
    if any(ids.get(name) != value for name, value in said.items()):
        return f"expected what its key says, got camera {message.camera!r:.80} of floor {message.floor!r:.80}"
    size = len(msgspec.msgpack.encode(message))
    if size > _LIMIT_BYTES:
        return f"expected at most {_LIMIT_BYTES} bytes, got {size} with {len(message.labels)} labels"
    for label, confidence in message.labels.items():
        if not 0.0 <= confidence <= 1.0:  # NaN neither
            return f"expected confidences of 0 to 1, got {confidence} for {label!r:.80}"
        if not 1 <= len(label) <= _MAX_LABEL_CHARS:
            return f"expected labels of 1 to {_MAX_LABEL_CHARS} characters, got {len(label)}"
    return ""
