"""What the cameras of all floors last reported, checked and gathered by floor: for choosing the floor."""

from __future__ import annotations

import msgspec

from surveilnav.bus import Node, Received
from surveilnav.contract import CAMERA_SUMMARY
from surveilnav.messages import CameraSummary

_LIMIT_BYTES = 512
_MAX_LABEL_CHARS = 64
_MAX_AGE_S = CAMERA_SUMMARY.max_age_ms / 1000


class Summaries:
    """The fresh summaries. What can't be is dropped, counted (``TrafficReport.rejected``) and logged, once a message."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._table = node.table(CAMERA_SUMMARY)
        self._judged: dict[str, tuple[int, bool]] = {}  # key -> when the newest came, and whether it is sound

    def by_floor(self) -> dict[str, dict[str, float]]:
        """Floor -> label -> highest confidence that a camera of that floor last reported.

        A floor whose cameras saw nothing is there with no label; one without fresh summaries isn't there.
        """
        floors: dict[str, dict[str, float]] = {}
        for row in self._sound():
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

    def held_bytes(self) -> int:
        """Bytes of the fresh summaries: what a choice made now stands on."""
        return sum(len(msgspec.msgpack.encode(row.message)) + len(row.key) for row in self._sound())

    def _sound(self) -> list[Received[CameraSummary]]:
        rows = self._table.rows(max_age_s=_MAX_AGE_S)
        return [row for row in rows if self._is_sound(row)]

    def _is_sound(self, row: Received[CameraSummary]) -> bool:
        received_ns, sound = self._judged.get(row.key, (0, False))
        if received_ns != row.received_ns:
            fault = fault_of(row.ids, row.message)
            sound = not fault
            self._judged[row.key] = row.received_ns, sound
            if fault:
                self._node.reject(CAMERA_SUMMARY.name, f"{row.key}: {fault}")
        return sound


def fault_of(ids: dict[str, str], message: CameraSummary) -> str:
    """What is wrong with a summary that came on the key with these ids; empty if nothing is."""
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
