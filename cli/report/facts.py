"""What the report's template shows of a run: gathered and put in order here, laid out there."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from surveilnav.cli.report.film import film_of
from surveilnav.cli.report.floor_map import (
    CAMERA,
    DECIDING,
    DOUBTED,
    IDLE,
    PATH,
    REJECTED,
    TARGET,
    MapContent,
    map_svg,
    value_svg,
)
from surveilnav.cli.report.key_moments import key_moments
from surveilnav.cli.report.record import Moment, RunRecord, Step, TrafficLine, plain
from surveilnav.cli.report.view_picture import view_svg
from surveilnav.cli.report.why import reasons
from surveilnav.cli.report.words import judgement, outcome
from surveilnav.cli.words import duration, human_bytes
from surveilnav.messages import ObjectRecord, Plan
from surveilnav.services.gateway.core.layers import COLOURS
from surveilnav.words import canonical

_MOST_OBJECTS = 12


class Tile(NamedTuple):
    """A number and a word about it."""

    name: str
    value: str
    more: str


class Drawing(NamedTuple):
    """The pictures of one floor. ``values``: the value map and the ends of its scale, where anything is known."""

    floor: str
    map: Markup
    values: tuple[Markup, float, float] | None


class TrafficGroup(NamedTuple):
    """Lines of one kind, the largest first. ``got`` heads the bytes that arrived, ``tip`` says at whom."""

    name: str
    got: str
    tip: str
    lines: Sequence[TrafficLine]


def facts_of(record: RunRecord) -> dict[str, Any]:
    """The variables of the template. Data that can't be drawn is left out."""
    tone, sentence = outcome(record)
    candidates = _candidates(record)
    moments = [m for m in record.timeline if math.isfinite(m.t_s)]
    film = film_of(record, candidates)
    return {
        "record": record,
        "tone": tone,
        "sentence": sentence,
        "judgement": judgement(record),
        "reasons": reasons(record, candidates),
        "tiles": _tiles(record),
        "drawings": _drawings(record, candidates[:_MOST_OBJECTS]),
        "legend": _legend(),
        "moments": key_moments(film, record.target) if film else [],
        "film": _json(film.data(record)) if film else "",
        "views": _views(record),
        "chosen": record.status.object_id if record.status else None,
        "candidates": candidates[:_MOST_OBJECTS],
        "n_left_out": max(0, len(candidates) - _MOST_OBJECTS),
        "others": _others(record, candidates),
        "decisions": _decisions(record.plans),
        "traffic": _traffic(record.traffic),
        "most_offered": max((line.offered for line in record.traffic), default=0) or 1,
        "phases": _phases(moments, record.seconds),
        "events": [
            m for before, m in zip([None, *moments], moments, strict=False) if not before or before[1:] != m[1:]
        ],
        "verdict": {name: _shown(plain(value)) for name, value in record.verdict.items()},
    }


def _tiles(record: RunRecord) -> list[Tile]:
    def number(name: str, form: str, unit: str = "") -> str:
        """With its unit; a dash if it is unknown."""
        value = record.number(name)
        return "–" if value is None else format(value, form) + unit

    totals, cameras = record.totals, f"{len(set(record.invoked))} of {len(record.cameras)}"
    return [
        Tile("steps", number("steps", ".0f"), f"of {record.status.max_steps}" if record.status else ""),
        Tile("path", number("path_m", ".1f", " m"), f"shortest {number('shortest_path_m', '.1f', ' m')}"),
        Tile("SPL", number("spl", ".2f"), "shortest ÷ walked, if right"),
        Tile(
            "time",
            duration(record.search_s) if record.search_s is not None else "–",
            f"of {duration(record.seconds)} with all",
        ),
        Tile("cameras", cameras, "in use" if record.surveillance else "surveillance off"),
        Tile("traffic", human_bytes(totals["offered"]), f"offered; {human_bytes(totals['wire'])} on the wire"),
        Tile("perception", record.perception, record.perception_why),
    ]


def _drawings(record: RunRecord, shown: Sequence[ObjectRecord]) -> list[Drawing]:
    """Floor by floor: those that were mapped or walked on."""
    drawings = []
    ids = {o.id for o in shown}
    walked = _walked(record)
    for floor in sorted(set(record.layers) | {s.floor for s in walked}):
        content = _content(record, floor, [o for o in record.objects if o.floor == floor and o.id in ids])
        values = value_svg(content, f"value map of floor {floor}")
        drawings.append(
            Drawing(
                floor,
                Markup(map_svg(content, f"map of floor {floor}")),
                (Markup(values[0]), *values[1:]) if values else None,
            )
        )
    return drawings


def _content(record: RunRecord, floor: str, objects: Sequence[ObjectRecord]) -> MapContent:
    walked = _walked(record)
    last = record.plans[-1] if record.plans else None
    here = last if last is not None and last.floor == floor else None
    return MapContent(
        target=record.target,
        layers=record.layers.get(floor, {}),
        path_m=np.array([[s.x_m, s.y_m] for s in walked if s.floor == floor], np.float64).reshape(-1, 2),
        planned_m=here.path_m if here else (),
        waypoint_m=(here.waypoint.x_m, here.waypoint.y_m) if here and here.waypoint else None,
        cameras=[c for c in record.cameras if c.floor == floor],
        invoked=frozenset(record.invoked),
        deciding=_deciding(record),
        objects=objects,
        starts=bool(walked) and walked[0].floor == floor,
        stops=bool(walked) and walked[-1].floor == floor,
    )


def _walked(record: RunRecord) -> list[Step]:
    return [s for s in record.trajectory if math.isfinite(s.x_m) and math.isfinite(s.y_m)]


def _deciding(record: RunRecord) -> frozenset[tuple[str, int]]:
    """(camera, view) that decided: as told, else those that saw the found object as the target."""
    told = [(v.source, v.view) for v in record.deciding_views if v.source and v.view is not None]
    if not told:
        target = canonical(record.target)
        told = [
            (e.source, e.view)
            for o in record.objects
            if record.status is not None and o.id == record.status.object_id
            for e in o.history
            if canonical(e.label) == target and e.what in ("created", "matched", "confirmed")
        ]
    return frozenset((source.removeprefix("camera/"), view) for source, view in told if source.startswith("camera/"))


def _legend() -> list[tuple[str, str, str]]:
    """(kind of mark, colour, what it stands for)."""
    layers = {name: f"#{''.join(f'{v:02x}' for v in rgb)}" for name, rgb in COLOURS.items() if rgb}
    return [
        ("", layers["explored"], "explored"),
        ("", layers["occupancy"], "obstacle"),
        ("", layers["frontier"], "frontier"),
        ("", "linear-gradient(90deg,#440154,#21918c,#fde725)", "value, low to high"),
        ("line", PATH, "way, start to stop"),
        ("dots", PATH, "planned on"),
        ("dot", CAMERA, "camera in use and what it covers"),
        ("dot", IDLE, "camera not in use"),
        ("ring", DECIDING, "camera and view that decided"),
        ("box", TARGET, "confirmed target"),
        ("box", DOUBTED, "taken for it by some view"),
        ("box", REJECTED, "rejected candidate"),
    ]


def _views(record: RunRecord) -> list[tuple[str, Markup | None]]:
    """(caption, picture or None if it doesn't decode) of each view that decided."""
    target = canonical(record.target)
    pictures = [(v.caption, view_svg(v.jpeg, v.boxes, target, v.caption)) for v in record.deciding_views]
    return [(caption, Markup(picture) if picture else None) for caption, picture in pictures]


def _candidates(record: RunRecord) -> list[ObjectRecord]:
    """Objects that anybody ever took for the target: what is called so now first, then confirmed, then by confidence."""
    target = canonical(record.target)

    def alike(o: ObjectRecord) -> bool:
        """Whether any source or detection ever called it so."""
        names = {o.label, o.label_robot, o.label_surveillance, *o.label_scores, *(e.label for e in o.history)}
        return target in {canonical(n) for n in names if n}

    order = {"confirmed": 0, "candidate": 1, "rejected": 2}
    chosen = record.status.object_id if record.status else None
    return sorted(
        (o for o in record.objects if alike(o)),
        key=lambda o: (
            o.id != chosen,
            canonical(o.label) != target,
            order[o.status],
            -o.confidence if math.isfinite(o.confidence) else 0.0,
            o.id,
        ),
    )


def _others(record: RunRecord, candidates: Sequence[ObjectRecord]) -> list[tuple[str, int]]:
    """(label, how many) of what else is on the map."""
    ids = {o.id for o in candidates}
    return Counter(o.label for o in record.objects if o.id not in ids and o.status != "rejected").most_common(30)


def _decisions(plans: Sequence[Plan]) -> list[Plan]:
    """The plans at which the waypoint changed."""
    changed: list[Plan] = []
    before: tuple[Any, ...] = ()
    for plan in plans:
        w = plan.waypoint
        now = (w.kind, round(w.x_m, 1), round(w.y_m, 1), w.object_id) if w else ("none",)
        if now != before:
            changed.append(plan)
        before = now
    return changed


def _traffic(lines: Sequence[TrafficLine]) -> list[TrafficGroup]:
    heads = {
        "camera": ("Cameras", "delivered", "what the others got of it"),
        "robot": ("Robots", "delivered", "what the others got of it"),
        "service": ("Services", "received", "what it got"),
    }
    ordered = sorted(lines, key=lambda line: (-line.offered, line.name))
    groups = [TrafficGroup(*head, [line for line in ordered if line.kind == kind]) for kind, head in heads.items()]
    return [group for group in groups if group.lines]


def _phases(moments: Sequence[Moment], seconds: float) -> dict[str, float]:
    """Seconds spent in each phase, in the order in which they began."""
    spans: dict[str, float] = {}
    ends = [m.t_s for m in moments[1:]] + [max(seconds, m.t_s) for m in moments[-1:]]
    for moment, end in zip(moments, ends, strict=True):
        spans[moment.phase] = spans.get(moment.phase, 0.0) + max(0.0, end - moment.t_s)
    return spans


def _json(data: dict[str, Any]) -> Markup:
    """As a script element may hold it: no text in it can end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def _shown(value: Any) -> str:
    return "–" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)
