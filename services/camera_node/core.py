"""What a camera node decides: which views to send now, which slot of the camera plan to take, what its summary says."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import msgspec

from surveilnav.messages import CameraSummary

#: A summary is for choosing the floor: it must stay this small whatever the camera sees.
SUMMARY_LIMIT_BYTES = 512
#: News may come sooner than the summary's own rate, but a camera that nobody invoked stays under 1 kB/s in all.
_NEWS_PERIOD_S = 2.0
#: A thumbnail of a smaller width shows nothing.
_LEAST_THUMBNAIL_PX = 64


@dataclass(frozen=True, slots=True)
class SendState:
    """What each view's listeners already have. ``sent``: content version last put, by view."""

    sent: Mapping[int, int] = field(default_factory=dict)


def views_to_send(
    state: SendState,
    *,
    versions: Mapping[int, int],
    matched: Collection[int],
    requested: Collection[int] = (),
    paused: bool = False,
) -> tuple[SendState, tuple[int, ...]]:
    """Decides which views to put now: those that somebody listens to and doesn't have, or asks for again.

    Args:
        versions: version of what each view shows now, by view; a new number means that the picture changed.
        matched: views whose publishers have a listener. Nobody listens: nothing is rendered, encoded or sent.
        requested: views that someone asked to have again; they too need a listener.
        paused: nothing is sent, and afterwards every listener gets each view anew.

    Returns:
        The next state, assuming that all are put, and the views, those asked for first. A view that loses its last
        listener is forgotten, so that the next listener gets it at once.
    """
    if paused:
        return SendState(), ()
    listened = [v for v in sorted(versions) if v in matched]
    due = [v for v in listened if v in requested or state.sent.get(v) != versions[v]]
    sent = {v: versions[v] if v in due else state.sent[v] for v in listened}
    return SendState(sent), tuple(sorted(due, key=lambda v: (v not in requested, v)))


@dataclass(frozen=True, slots=True)
class Seen:
    """What a camera's own perception saw in one view: which version of it, and label -> highest confidence."""

    version: int
    labels: Mapping[str, float]


def view_to_look_at(seen: Mapping[int, Seen], versions: Mapping[int, int]) -> int | None:
    """The next view for the camera's own perception: one never looked at, else one that changed since; None if none is.

    The view whose last look is the most versions old comes first.
    """
    stale = [v for v in versions if v not in seen or seen[v].version != versions[v]]
    return min(stale, key=lambda v: (v in seen, seen[v].version - versions[v] if v in seen else 0, v), default=None)


def labels_of(seen: Mapping[int, Seen]) -> dict[str, float]:
    """Label -> highest confidence over all views."""
    labels: dict[str, float] = {}
    for view in seen.values():
        for label, confidence in view.labels.items():
            labels[label] = max(confidence, labels.get(label, 0.0))
    return labels


def summary_due(waited_s: float, *, news: bool, period_s: float) -> bool:
    """Whether the summary is put now, ``waited_s`` after the last one: at its rate, sooner if there is news."""
    return waited_s >= (min(_NEWS_PERIOD_S, period_s) if news else period_s)


def choose_slot(claimed: Collection[int], total: int, node_id: str) -> int | None:
    """A free slot of the camera plan, or None if all are taken.

    Every node begins at a place of its own, so that replicas that start together seldom try the same slot.
    """
    if total <= 0:
        return None
    start = zlib.crc32(node_id.encode()) % total
    return next((s % total for s in range(start, start + total) if s % total not in claimed), None)


def keeps_slot(node_id: str, rivals: Collection[str]) -> bool:
    """Whether a node that finds others on its slot keeps it: the smallest id does, the others choose again."""
    return all(node_id <= rival for rival in rivals)


def summary(
    camera: str, floor: str, labels: Mapping[str, float], *, stamp_ns: int, limit_bytes: int = SUMMARY_LIMIT_BYTES
) -> CameraSummary:
    """The summary with as many labels as fit into ``limit_bytes`` of MessagePack, the surest first."""
    ranked = sorted(labels.items(), key=lambda item: (-item[1], item[0]))
    kept: dict[str, float] = {}
    message = CameraSummary(stamp_ns=stamp_ns, camera=camera, floor=floor, labels=kept)
    for label, confidence in ranked:
        kept = {**kept, label: round(float(confidence), 3)}
        larger = CameraSummary(stamp_ns=stamp_ns, camera=camera, floor=floor, labels=kept)
        if len(msgspec.msgpack.encode(larger)) > limit_bytes:
            break
        message = larger
    return message


def thumbnail_width_px(asked_px: int, most_px: int) -> int:
    """How wide a thumbnail is that is asked for with a width; 0 asks for the most."""
    return min(max(asked_px, _LEAST_THUMBNAIL_PX), most_px) if asked_px else most_px
