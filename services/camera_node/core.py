"""What a camera node decides: which views to send now, which slot of the camera plan to take, what its summary says."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import msgspec

from surveilnav.messages import CameraSummary

#: Size limit of a summary, which every planner gets from every camera.
SUMMARY_LIMIT_BYTES = 512
#: A summary with news is sent earlier than the regular rate, but a camera that nobody invoked must stay under 1 kB/s.
_NEWS_PERIOD_S = 2.0
#: Thumbnails below this width show nothing useful.
_MIN_THUMBNAIL_PX = 64


@dataclass(frozen=True, slots=True)
class SendState:
    """What the listeners have already. ``sent``: by view, the version of its picture that was sent last."""

    sent: Mapping[int, int] = field(default_factory=dict)


def views_to_send(
    state: SendState,
    *,
    versions: Mapping[int, int],
    matched: Collection[int],
    requested: Collection[int] = (),
    paused: bool = False,
) -> tuple[SendState, tuple[int, ...]]:
    """Decides which views to send now: those with a listener that doesn't have the present version or asks for it again.

    Args:
        versions: by view, the version of its present picture; a new number means that the picture changed.
        matched: views whose publishers have a listener. Views without one are neither rendered nor encoded nor sent.
        requested: views that somebody asked to have again; they are sent only if they have a listener.
        paused: nothing is sent; when the pause ends every listener gets each view again.

    Returns:
        The next state, assuming that all these views are sent, and the views, requested ones first. A view that loses
        its last listener is dropped from the state, so that the next listener gets it at once.
    """
    if paused:
        return SendState(), ()
    listened = [v for v in sorted(versions) if v in matched]
    due = [v for v in listened if v in requested or state.sent.get(v) != versions[v]]
    sent = {v: versions[v] if v in due else state.sent[v] for v in listened}
    return SendState(sent), tuple(sorted(due, key=lambda v: (v not in requested, v)))


@dataclass(frozen=True, slots=True)
class ViewLabels:
    """What the camera's own detector found in one view: ``labels`` (label -> highest confidence) at picture ``version``."""

    version: int
    labels: Mapping[str, float]


def next_view_to_examine(examined: Mapping[int, ViewLabels], versions: Mapping[int, int]) -> int | None:
    """The view that the camera's own detector should see next; None if it has seen the present version of all.

    Views never examined come first, then the one whose result is the most versions old.
    """
    stale = [v for v in versions if v not in examined or examined[v].version != versions[v]]

    def priority(v: int) -> tuple[bool, int, int]:
        return v in examined, examined[v].version - versions[v] if v in examined else 0, v

    return min(stale, key=priority, default=None)


def merge_labels(examined: Mapping[int, ViewLabels]) -> dict[str, float]:
    """Label -> highest confidence over all views."""
    labels: dict[str, float] = {}
    for view in examined.values():
        for label, confidence in view.labels.items():
            labels[label] = max(confidence, labels.get(label, 0.0))
    return labels


def summary_due(since_last_s: float, *, news: bool, period_s: float) -> bool:
    """Whether to send the summary now, ``since_last_s`` after the last one: every ``period_s``, earlier if there is news."""
    return since_last_s >= (min(_NEWS_PERIOD_S, period_s) if news else period_s)


def choose_slot(claimed: Collection[int], total: int, node_id: str) -> int | None:
    """A free slot of the camera plan, or None if all ``total`` are claimed.

    Each node starts its search at a slot that depends on its id, so that replicas started together seldom collide.
    """
    if total <= 0:
        return None
    start = zlib.crc32(node_id.encode()) % total
    return next((s % total for s in range(start, start + total) if s % total not in claimed), None)


def keeps_slot(node_id: str, rivals: Collection[str]) -> bool:
    """Whether a node keeps a slot that ``rivals`` claim, too: the smallest id does, the others choose again."""
    return all(node_id <= rival for rival in rivals)


def build_summary(
    camera: str, floor: str, labels: Mapping[str, float], *, stamp_ns: int, limit_bytes: int = SUMMARY_LIMIT_BYTES
) -> CameraSummary:
    """The summary with as many labels as fit into ``limit_bytes`` of MessagePack, in order of confidence."""
    ranked = sorted(labels.items(), key=lambda item: (-item[1], item[0]))
    included: dict[str, float] = {}
    message = CameraSummary(stamp_ns=stamp_ns, camera=camera, floor=floor, labels=included)
    for label, confidence in ranked:
        included = {**included, label: round(float(confidence), 3)}
        larger = CameraSummary(stamp_ns=stamp_ns, camera=camera, floor=floor, labels=included)
        if len(msgspec.msgpack.encode(larger)) > limit_bytes:
            break
        message = larger
    return message


def thumbnail_width_px(requested_px: int, max_px: int) -> int:
    """The width of a thumbnail for a request; 0 asks for the largest that the settings allow."""
    return min(max(requested_px, _MIN_THUMBNAIL_PX), max_px) if requested_px else max_px
