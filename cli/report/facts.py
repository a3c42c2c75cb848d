"""What the report's template shows of a run: gathered and put in order here, laid out there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from surveilnav.cli.report.record import DecidingView, RunRecord, TrafficLine, candidates_of
from surveilnav.cli.report.small_pictures import size_of, small_picture
from surveilnav.cli.report.why import reasons
from surveilnav.cli.report.words import judgement, outcome
from surveilnav.cli.words import duration, human_bytes
from surveilnav.words import canonical

_STILL_PX, _STILL_QUALITY = 760, 75


class Tile(NamedTuple):
    """A number and a word about it."""

    name: str
    value: str
    more: str


class Detection(NamedTuple):
    """A box in percent of a picture's size. ``hit``: it is of the target's class."""

    left: float
    top: float
    width: float
    height: float
    text: str
    hit: bool


class Still(NamedTuple):
    """A view that decided. ``picture``: WebP; empty where the view's doesn't decode."""

    caption: str
    picture: bytes
    detections: Sequence[Detection]


class TrafficGroup(NamedTuple):
    """Lines of one kind, the largest first. ``got`` heads the bytes that arrived, ``tip`` says at whom."""

    name: str
    got: str
    tip: str
    lines: Sequence[TrafficLine]


def facts_of(record: RunRecord) -> dict[str, Any]:
    """The variables of the template that come from the record alone."""
    tone, sentence = outcome(record)
    return {
        "record": record,
        "tone": tone,
        "sentence": sentence,
        "judgement": judgement(record),
        "reasons": reasons(record, candidates_of(record)),
        "tiles": _tiles(record),
        "stills": [_still(view, canonical(record.target)) for view in record.deciding_views],
        "traffic": _traffic(record.traffic),
        "most_offered": max((line.offered for line in record.traffic), default=0) or 1,
    }


def _tiles(record: RunRecord) -> list[Tile]:
    def number(name: str, form: str, unit: str = "") -> str:
        """With its unit; a dash if it is unknown."""
        value = record.number(name)
        return "–" if value is None else format(value, form) + unit

    totals, cameras = record.totals, f"{len(set(record.invoked))} of {len(record.cameras)}"
    search = duration(record.search_s) or "–"
    return [
        Tile("steps", number("steps", ".0f"), f"of {record.status.max_steps}" if record.status else ""),
        Tile("path", number("path_m", ".1f", " m"), f"shortest {number('shortest_path_m', '.1f', ' m')}"),
        Tile("SPL", number("spl", ".2f"), "shortest ÷ walked, if right"),
        Tile("time", search, f"of {duration(record.seconds)} with all"),
        Tile("cameras", cameras, "in use" if record.surveillance else "surveillance off"),
        Tile("traffic", human_bytes(totals["offered"]), f"offered; {human_bytes(totals['wire'])} on the wire"),
        Tile("perception", record.perception, record.perception_why),
    ]


def _still(view: DecidingView, target: str) -> Still:
    return Still(
        view.caption, small_picture(view.jpeg, _STILL_PX, _STILL_QUALITY), list(_detections(view, canonical(target)))
    )


def _detections(view: DecidingView, target: str) -> Iterator[Detection]:
    """The boxes, cut to the picture; the target's last, so that it lies on top."""
    width, height = size_of(view.jpeg)
    for x0, y0, x1, y1, label, score in sorted(view.boxes, key=lambda box: canonical(box[4]) == target):
        if not all(map(math.isfinite, (x0, y0, x1, y1))):
            continue
        left, right = (100 * min(max(x / width, 0.0), 1.0) for x in (x0, x1))
        top, bottom = (100 * min(max(y / height, 0.0), 1.0) for y in (y0, y1))
        yield Detection(left, top, right - left, bottom - top, f"{label} {score:.2f}", canonical(label) == target)


def _traffic(lines: Sequence[TrafficLine]) -> list[TrafficGroup]:
    heads = {
        "camera": ("Cameras", "delivered", "what the others got of it"),
        "robot": ("Robots", "delivered", "what the others got of it"),
        "service": ("Services", "received", "what it got"),
    }
    ordered = sorted(lines, key=lambda line: (-line.offered, line.name))
    groups = [TrafficGroup(*head, [line for line in ordered if line.kind == kind]) for kind, head in heads.items()]
    return [group for group in groups if group.lines]
