"""What the maps held of objects that may be the target, as it became known along the steps of a search."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

from surveilnav.cli.report.record import Step
from surveilnav.messages import ObjectRecord

_MOST_OBJECTS, _MOST_LINES, _MOST_SOURCES = 12, 600, 6
#: Events that change how sure the maps are of an object.
_STATUS = {"created": "candidate", "confirmed": "confirmed", "rejected": "rejected", "flipped": "candidate"}


class Belief(NamedTuple):
    """From step number ``frame`` on: object, label and best score so far, status, and who had seen it, the first first."""

    frame: int
    object_id: int
    label: str
    score: float
    status: str
    sources: str


def beliefs_of(objects: Sequence[ObjectRecord], steps: Sequence[Step]) -> list[Belief]:
    """What changed about each of the first objects, in the order of steps."""
    told = [belief for record in objects[:_MOST_OBJECTS] for belief in _of(record, steps)]
    return sorted(told, key=lambda b: b.frame)[:_MOST_LINES]


def _of(record: ObjectRecord, steps: Sequence[Step]) -> list[Belief]:
    stamps = [step.stamp_ns for step in steps]
    best, status, sources, known_ns = 0.0, "candidate", dict[str, None](), 0
    told: list[Belief] = []
    for event in record.history:
        # A history's order is that of becoming known; a view that waited in a queue was taken earlier than it was known.
        known_ns = max(known_ns, event.stamp_ns)
        frame = min(bisect_left(stamps, known_ns), len(steps) - 1)
        if event.what != "not_seen":
            best = max(best, event.score) if math.isfinite(event.score) else best
            sources[event.source] = None
        status = _STATUS.get(event.what, status)
        names = ", ".join(_who(s) for s in list(sources)[:_MOST_SOURCES])
        belief = Belief(frame, record.id, event.label or record.label, round(best, 2), status, names)
        if told and told[-1].frame == frame:
            told.pop()
        if not told or told[-1][1:] != belief[1:]:
            told.append(belief)
    return told


def _who(source: str) -> str:
    kind, _, name = source.partition("/")
    return "the robot" if kind == "robot" else f"{kind} {name}" if name else source
