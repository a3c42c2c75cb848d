"""The camera's own perception: which view it should see next, and the summary of what it found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from surveilnav.messages import CameraSummary

#: Size limit of a summary, which every planner gets from every camera.
SUMMARY_LIMIT_BYTES = 512
#: A summary with news is sent earlier than the regular rate, but a camera that nobody invoked must stay under 1 kB/s.
_NEWS_PERIOD_S = 2.0


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
