"""Why a search failed, in plain words: only what its record says."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.cli.report.record import RunRecord
from surveilnav.cli.report.words import with_article
from surveilnav.messages import ObjectRecord
from surveilnav.words import canonical

_EDGE_CELLS = 4
_STANDING = {"candidate": "nobody was sure of it", "confirmed": "it was confirmed", "rejected": "it was rejected"}
_LED = {
    "frontier": "to edges of what was known",
    "candidate": "to what might be the target",
    "target": "to what was confirmed as the target",
    "stairs": "to stairs",
    "second_look": "to second looks around",
    "": "to looking around",
}


def reasons(record: RunRecord, candidates: Sequence[ObjectRecord]) -> list[str]:
    """Sentences, the nearest cause first; ``candidates``: what anybody took for the target. None for a success."""
    if record.success or record.status is None:
        return []
    told = [
        _steps(record),
        _taken(record),
        _likeliest(record, candidates),
        _edges(record),
        _cameras(record),
        _distance(record),
    ]
    return [sentence for sentence in told if sentence]


def _steps(record: RunRecord) -> str:
    """What the steps were spent on."""
    kinds = Counter(p.waypoint.kind if p.waypoint is not None else "" for p in record.plans)
    if not kinds:
        return "Nothing is known of what the robot planned."
    spent = ", ".join(f"{n} {_LED[kind]}" for kind, n in kinds.most_common())
    return f"Of {sum(kinds.values())} planned steps these led: {spent}."


def _taken(record: RunRecord) -> str:
    """What it stopped for, if it did."""
    chosen = record.chosen
    return f"It stopped for {_described(chosen)}" if chosen is not None and record.found else ""


def _likeliest(record: RunRecord, candidates: Sequence[ObjectRecord]) -> str:
    """What else came nearest to being the target."""
    if not candidates:
        return f"Neither the robot nor a camera ever took anything for {with_article(record.target)}."
    target = canonical(record.target)
    called = [o for o in candidates if canonical(o.label) == target and o is not record.chosen]
    best = max(called, key=lambda o: o.confidence if math.isfinite(o.confidence) else 0.0, default=None)
    if best is not None:
        return f"The likeliest{' of the others' if _taken(record) else ''} was {_described(best)}"
    if _taken(record):
        return ""
    other = candidates[0].label or "nothing"
    return f"What was once taken for {with_article(record.target)} turned out to be something else: {other}."


def _described(o: ObjectRecord) -> str:
    standing = _STANDING[o.status] + (f": {o.reason}" if o.reason else "")
    return f"object {o.id}, called {o.label or 'nothing'}, with a confidence of {o.confidence:.2f}; {standing}."


def _edges(record: RunRecord) -> str:
    """How much was left to explore, by the maps at the end."""
    if not any("frontier" in layers for layers in record.layers.values()):
        return ""
    cells = [layers["frontier"][1] for layers in record.layers.values() if "frontier" in layers]
    n = sum(_stretches(np.asarray(c != 0, np.uint8)) for c in cells)
    if not n:
        return "At the end, no edge of what was known was left to explore."
    return f"At the end, {n} edge{'s' if n > 1 else ''} of what was known waited to be explored."


def _stretches(cells: NDArray[np.uint8]) -> int:
    """How many connected stretches of cells there are; crumbs don't count."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(cells, connectivity=8)
    return int((stats[1:, cv2.CC_STAT_AREA] >= _EDGE_CELLS).sum())


def _cameras(record: RunRecord) -> str:
    if not record.surveillance:
        return "No surveillance camera took part."
    n = len(set(record.invoked))
    return f"{n} of {len(record.cameras)} cameras were asked for pictures."


def _distance(record: RunRecord) -> str:
    away = record.number("distance_to_viewpoint_m")
    if away is None:
        return ""
    place = f"the nearest place from which {with_article(record.target)} counts as found"
    return f"At the end the robot was {away:.1f} m from {place}."
