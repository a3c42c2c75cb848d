"""What a run leaves behind: ``run.json`` for programs, ``report.html`` for people.

    record = RunRecord(building="SweetHome3DExample", ...)
    write_report(record, run_dir / "report.html")
    json.dumps(run_json(record, run_dir / "report.html"))

The report is one file: pictures are inside, nothing is loaded from elsewhere, no script runs.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from html import escape
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from cli.report_map import (
    CAMERA,
    DECIDING,
    IDLE,
    PATH,
    REJECTED,
    TARGET,
    Layers,
    MapContent,
    map_svg,
    value_svg,
    view_svg,
)
from services.gateway.core.traffic import sum_traffic
from surveilnav.categories import canonical
from surveilnav.messages import CameraInfo, MissionStatus, ObjectRecord, Plan, TrafficReport

_CSS = Path(__file__).with_name("report.css")
_MOST_OBJECTS = 12
_MOST_ROWS = 400


class Step(NamedTuple):
    """Where the robot was after ``action``: world metres and radians. ``action`` is "" for the start."""

    x_m: float
    y_m: float
    yaw_rad: float
    floor: str
    step: int
    action: str


class DecidingView(NamedTuple):
    """A view that decided: its JPEG and detections (x0, y0, x1, y1 [px], label, score).

    ``source`` ("camera/c1", "robot/r1") and ``view`` let the map highlight the camera; without them it looks at
    the history of the object that was found.
    """

    caption: str
    jpeg: bytes
    boxes: Sequence[tuple[float, float, float, float, str, float]]
    source: str = ""
    view: int | None = None


class TrafficLine(NamedTuple):
    """Bytes of a camera, robot or service.

    ``offered``: what it put or asked. ``delivered``: for a camera or robot, what the others got under its keys; for
    a service, what it got. ``wire``: sent by its sockets as the kernel counts it, None if unknown.
    """

    name: str
    kind: Literal["camera", "robot", "service"]
    offered: int
    delivered: int
    wire: int | None


class Moment(NamedTuple):
    t_s: float
    phase: str
    message: str


@dataclass
class RunRecord:
    """All that is known of one run.

    Attributes:
        perception, perception_why: the backend that ran, and why that one.
        status: the mission's last status; None if the run ended before there was one.
        verdict: the simulator's check: found, success, steps, spl, path_m, shortest_path_m,
            distance_to_viewpoint_m, ...; what is missing is taken from ``status`` or left out.
        layers: floor -> layer -> (grid, cells): occupancy, explored, frontier uint8; value float32 with NaN.
        invoked: names of the cameras that fusion subscribed to.
        objects: the object map of all floors at the end.
    """

    building: str
    seed: int
    target: str
    perception: str
    perception_why: str
    surveillance: bool
    started: datetime
    seconds: float
    status: MissionStatus | None = None
    verdict: dict[str, Any] = field(default_factory=dict)
    trajectory: Sequence[Step] = ()
    plans: Sequence[Plan] = ()
    layers: dict[str, Layers] = field(default_factory=dict)
    cameras: Sequence[CameraInfo] = ()
    invoked: Sequence[str] = ()
    objects: Sequence[ObjectRecord] = ()
    deciding_views: Sequence[DecidingView] = ()
    traffic: Sequence[TrafficLine] = ()
    timeline: Sequence[Moment] = ()
    notes: Sequence[str] = ()

    @property
    def found(self) -> bool:
        """The planner confirmed a target and stopped."""
        ended_well = self.status is not None and self.status.found and self.status.state == "done"
        return bool(self.verdict.get("found", ended_well))

    @property
    def success(self) -> bool:
        """The simulator agrees."""
        return bool(self.verdict.get("success", False))

    def number(self, name: str) -> float | None:
        """A number of the verdict or, for steps and path_m, of the status; None if unknown or not finite."""
        fallback = {"steps": "step", "path_m": "path_m"}.get(name)
        value = self.verdict.get(name, getattr(self.status, fallback, None) if fallback else None)
        return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None

    @property
    def totals(self) -> dict[str, int | None]:
        """Bytes offered, delivered and on the wire (sent), over all lines."""
        wire = [line.wire for line in self.traffic if line.wire is not None]
        return {
            "offered": sum(line.offered for line in self.traffic),
            "delivered": sum(line.delivered for line in self.traffic),
            "wire": sum(wire) if wire else None,
        }


def traffic_lines(reports: Iterable[TrafficReport]) -> list[TrafficLine]:
    """The report's rows from what every node counted: cameras, robots, then services."""
    sums = sum_traffic(reports)
    lines = [TrafficLine(s.id, "camera", s.offered_bytes, s.delivered_bytes, s.wire_sent_bytes) for s in sums.cameras]
    lines += [TrafficLine(s.id, "robot", s.offered_bytes, s.delivered_bytes, s.wire_sent_bytes) for s in sums.robots]
    sources = {s.node for s in (*sums.cameras, *sums.robots)}
    for n in sums.nodes:
        if f"{n.kind}/{n.node}" not in sources:
            name = n.node if n.node.startswith(n.kind) else f"{n.kind} {n.node}"
            lines.append(TrafficLine(name, "service", n.offered_bytes, n.delivered_bytes, n.wire_sent_bytes))
    return lines


def run_json(record: RunRecord, report: Path | None = None) -> dict[str, Any]:
    """The run as plain JSON values; numbers that are unknown or not finite are null."""
    steps = record.number("steps")
    status = record.status
    rest = {k: _plain(v) for k, v in record.verdict.items()}
    return rest | {
        "building": record.building,
        "seed": record.seed,
        "target": record.target,
        "found": record.found,
        "success": record.success,
        "state": status.state if status else None,
        "error": (status.error or None) if status else None,
        "message": status.message if status else "",
        "steps": int(steps) if steps is not None else None,
        "spl": record.number("spl"),
        "path_m": record.number("path_m"),
        "shortest_path_m": record.number("shortest_path_m"),
        "seconds": round(record.seconds, 3),
        "started": record.started.isoformat(),
        "perception": record.perception,
        "perception_why": record.perception_why,
        "surveillance": record.surveillance,
        "cameras": len(record.cameras),
        "invoked_cameras": sorted(record.invoked),
        "traffic": record.totals,
        "notes": list(record.notes),
        "report": str(report) if report else None,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value if isinstance(value, (str, int, bool, type(None))) else str(value)


# --- words --------------------------------------------------------------------------------------------------------

_FAILURES = {
    "not_found": "everything reachable was searched and nothing passed for one",
    "unreachable": "there is no way to it",
    "out_of_steps": "the robot ran out of steps",
    "robot_lost": "the robot was lost",
    "perception_down": "perception was down",
    "fusion_down": "fusion was down",
    "stuck": "the robot was stuck",
    "bad_target": "this isn't a target that can be searched for",
}


def outcome(record: RunRecord) -> tuple[Literal["good", "half", "bad"], str]:
    """How the run ended, in one sentence."""
    steps, path, shortest = record.number("steps"), record.number("path_m"), record.number("shortest_path_m")
    effort = f" after {steps:.0f} steps and {path:.1f} m" if steps is not None and path is not None else ""
    if record.success:
        best = f" (the shortest way is {shortest:.1f} m)" if shortest is not None else ""
        return "good", f"Found the {record.target}: the robot stopped where it should{effort}{best}."
    if record.found:
        away = record.number("distance_to_viewpoint_m")
        how = f": it is {away:.1f} m from the nearest place that counts" if away is not None else ""
        return "half", f"Stopped for a {record.target}{effort}, but the simulator's check says no{how}."
    status = record.status
    if status is None:
        return "bad", f"The run ended before its mission for a {record.target} had a status."
    if status.state == "cancelled":
        return "bad", f"The search for a {record.target} was cancelled{effort}."
    if status.state not in ("failed", "done"):
        return "bad", f"The search for a {record.target} didn't end: it was {status.state} ({status.phase}){effort}."
    why = _FAILURES.get(status.error, status.error.replace("_", " ") or "no reason was given")
    return "bad", f"Didn't find a {record.target}{effort}: {why}."


def human_bytes(n: int | None) -> str:
    """Decimal units, two or three figures: "312 B", "4.7 kB", "81 MB"."""
    if n is None:
        return "–"
    value, unit = float(n), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if value < 999.5 or unit == "TB":
            break
        value /= 1000
    return f"{value:.1f} {unit}" if value < 9.95 and unit != "B" else f"{value:.0f} {unit}"


# --- the page -----------------------------------------------------------------------------------------------------


def write_report(record: RunRecord, path: Path) -> None:
    """Writes the report; its folder must exist. A stretch of data that can't be drawn is left out and said so."""
    tone, sentence = outcome(record)
    title = f"{record.target} in {record.building}"
    sections = [
        _facts(record),
        *(f'<p class="note">{escape(note)}</p>' for note in record.notes),
        _maps(record),
        _views(record),
        _objects(record),
        _decisions(record),
        _traffic(record),
        _timeline(record),
        _verdict(record),
    ]
    status = f'<p class="soft">{escape(record.status.message)}</p>' if record.status and record.status.message else ""
    path.write_text(
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title>"
        f"<style>{_CSS.read_text(encoding='utf-8')}</style></head><body><main>"
        f'<header><p class="kicker">SurveilNav · {escape(title)} · seed {record.seed}</p>'
        f'<h1 class="{tone}">{escape(sentence)}</h1>{status}</header>{"".join(sections)}'
        f"<footer>started {record.started.isoformat(sep=' ', timespec='seconds')}</footer></main></body></html>\n",
        encoding="utf-8",
    )


def _facts(record: RunRecord) -> str:
    def number(name: str, form: str, unit: str = "") -> str:
        value = record.number(name)
        return "–" if value is None else format(value, form) + unit

    totals = record.totals
    tiles = [
        ("steps", number("steps", ".0f"), f"of {record.status.max_steps}" if record.status else ""),
        ("path", number("path_m", ".1f", " m"), f"shortest {number('shortest_path_m', '.1f', ' m')}"),
        ("SPL", number("spl", ".2f"), "shortest ÷ walked, if right"),
        ("time", f"{record.seconds:.0f} s", "from start to outcome"),
        (
            "cameras",
            f"{len(set(record.invoked))} of {len(record.cameras)}",
            "in use" if record.surveillance else "surveillance off",
        ),
        ("traffic", human_bytes(totals["offered"]), f"offered; {human_bytes(totals['wire'])} on the wire"),
        ("perception", escape(record.perception), escape(record.perception_why)),
    ]
    cells = (f"<div><dt>{name}</dt><dd>{value}<small>{more}</small></dd></div>" for name, value, more in tiles)
    return f'<dl class="tiles">{"".join(cells)}</dl>'


def _section(title: str, *content: str) -> str:
    body = "".join(content)
    return f"<section><h2>{escape(title)}</h2>{body}</section>" if body else ""


def _contents(record: RunRecord) -> list[tuple[str, MapContent]]:
    """What to draw, floor by floor: those that were mapped or walked on."""
    walked = [s for s in record.trajectory if math.isfinite(s.x_m) and math.isfinite(s.y_m)]
    floors = sorted(set(record.layers) | {s.floor for s in walked})
    shown = {o.id for o in _candidates(record)[:_MOST_OBJECTS]}
    deciding = _deciding(record)
    last = record.plans[-1] if record.plans else None
    contents = []
    for floor in floors:
        way = np.array([[s.x_m, s.y_m] for s in walked if s.floor == floor], np.float64).reshape(-1, 2)
        here = last if last is not None and last.floor == floor else None
        contents.append(
            (
                floor,
                MapContent(
                    layers=record.layers.get(floor, {}),
                    path_m=way,
                    planned_m=here.path_m if here else (),
                    waypoint_m=(here.waypoint.x_m, here.waypoint.y_m) if here and here.waypoint else None,
                    cameras=[c for c in record.cameras if c.floor == floor],
                    invoked=frozenset(record.invoked),
                    deciding=deciding,
                    objects=[o for o in record.objects if o.floor == floor and o.id in shown],
                    starts=bool(walked) and walked[0].floor == floor,
                    stops=bool(walked) and walked[-1].floor == floor,
                ),
            )
        )
    return contents


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


def _maps(record: RunRecord) -> str:
    contents = _contents(record)
    maps, values = [], []
    for floor, content in contents:
        name = f"<h3>Floor {escape(floor)}</h3>" if len(contents) > 1 else ""
        maps.append(f'{name}<div class="paper">{map_svg(content, f"map of floor {floor}")}</div>')
        if drawn := value_svg(content, f"value map of floor {floor}"):
            svg, low, high = drawn
            values.append(
                f'{name}<div class="paper">{svg}</div>'
                f'<p class="scale"><span>{low:.2f}</span><i></i><span>{high:.2f}</span>'
                f"<em>how likely a {escape(record.target)} is near, by what the views resemble</em></p>"
            )
    return _section("Where it went", *maps, _LEGEND if maps else "") + _section("What it expected where", *values)


def _swatch(colour: str, text: str, kind: str = "") -> str:
    return f'<li><i class="{kind}" style="--c:{colour}"></i>{text}</li>'


_LEGEND = (
    '<ul class="legend">'
    + "".join(
        [
            _swatch("#dbe7f0", "explored"),
            _swatch("#39424e", "obstacle"),
            _swatch("#f08c00", "frontier"),
            _swatch("linear-gradient(90deg,#440154,#21918c,#fde725)", "value, low to high"),
            _swatch(PATH, "way, start to stop", "line"),
            _swatch(PATH, "planned on", "dots"),
            _swatch(CAMERA, "camera in use and what it covers", "dot"),
            _swatch(IDLE, "camera not in use", "dot"),
            _swatch(DECIDING, "camera and view that decided", "ring"),
            _swatch(TARGET, "confirmed target", "box"),
            _swatch(REJECTED, "rejected candidate", "box"),
        ]
    )
    + "</ul>"
)


def _views(record: RunRecord) -> str:
    target = canonical(record.target)
    figures = []
    for view in record.deciding_views:
        svg = view_svg(view.jpeg, view.boxes, target, view.caption)
        picture = svg or '<p class="soft">this picture doesn\'t decode</p>'
        figures.append(f"<figure>{picture}<figcaption>{escape(view.caption)}</figcaption></figure>")
    return _section("The views that decided", f'<div class="views">{"".join(figures)}</div>' if figures else "")


def _candidates(record: RunRecord) -> list[ObjectRecord]:
    """Objects that anybody ever took for the target: confirmed first, then by confidence."""
    target = canonical(record.target)

    def alike(o: ObjectRecord) -> bool:
        names = {o.label, o.label_robot, o.label_surveillance, *o.label_scores, *(e.label for e in o.history)}
        return target in {canonical(n) for n in names if n}

    order = {"confirmed": 0, "candidate": 1, "rejected": 2}
    chosen = record.status.object_id if record.status else None
    return sorted(
        (o for o in record.objects if alike(o)),
        key=lambda o: (o.id != chosen, order[o.status], -o.confidence if math.isfinite(o.confidence) else 0.0, o.id),
    )


def _objects(record: RunRecord) -> str:
    candidates = _candidates(record)
    chosen = record.status.object_id if record.status else None
    parts = [_object(o, o.id == chosen) for o in candidates[:_MOST_OBJECTS]]
    if len(candidates) > _MOST_OBJECTS:
        parts.append(f'<p class="soft">and {len(candidates) - _MOST_OBJECTS} more that nobody was sure of</p>')
    if not candidates:
        parts.append(f'<p class="soft">Nothing was ever taken for a {escape(record.target)}.</p>')
    ids = {o.id for o in candidates}
    rest = Counter(o.label for o in record.objects if o.id not in ids and o.status != "rejected")
    if rest:
        chips = "".join(f"<li>{escape(label)} <b>{n}</b></li>" for label, n in rest.most_common(30))
        parts.append(f'<h3>Else on the map</h3><ul class="chips">{chips}</ul>')
    return _section(f"What was taken for a {record.target}", *parts)


def _object(o: ObjectRecord, chosen: bool) -> str:
    rows = [
        (
            f"{escape(e.source)}",
            str(e.view) if e.source.startswith("camera") else "",
            str(e.seq),
            escape(e.label),
            f"{e.score:.2f}",
            f'<b class="{e.what}">{escape(e.what.replace("_", " "))}</b>',
            escape(e.note),
        )
        for e in o.history
    ]
    head = (
        f'<summary><b class="{o.status}">{o.status}</b> <strong>#{o.id} {escape(o.label)}</strong> '
        f"<span>{o.confidence:.2f}</span> <em>{escape(o.reason)}</em>"
        f"{'<mark>the one it went to</mark>' if chosen else ''}</summary>"
    )
    said = [
        f"{who} says {escape(label)} ({score:.2f})"
        for who, label, score in (
            ("robot", o.label_robot, o.confidence_robot),
            ("surveillance", o.label_surveillance, o.confidence_surveillance),
        )
        if label
    ]
    where = f"at ({o.center_m[0]:.1f}, {o.center_m[1]:.1f}, {o.center_m[2]:.1f}) m, floor {escape(o.floor)}"
    facts = "; ".join([*said, f"{o.n_detections} detections", where])
    table = _table(("source", "view", "seq", "label", "score#", "came of it", "note"), rows) if rows else ""
    return f'<details class="object"{" open" if chosen else ""}>{head}<p class="soft">{facts}</p>{table}</details>'


def _decisions(record: RunRecord) -> str:
    """The planner's waypoints, one line for each change."""
    rows: list[tuple[str, ...]] = []
    before: tuple[Any, ...] = ()
    for plan in record.plans:
        w = plan.waypoint
        now = (w.kind, round(w.x_m, 1), round(w.y_m, 1), w.object_id) if w else ("none",)
        if now != before:
            place = f"({w.x_m:.1f}, {w.y_m:.1f})" if w else ""
            rows.append(
                (
                    str(plan.step),
                    escape(w.kind if w else "none"),
                    place,
                    f"{w.score:.2f}" if w else "",
                    str(sum(c.kind == "frontier" for c in plan.candidates)),
                    escape(w.note if w else ""),
                )
            )
        before = now
    if not rows:
        return ""
    table = _table(("step#", "goes for", "where [m]", "score#", "frontiers#", "why"), rows)
    return _section("What the planner chose", _fold(table, len(rows), "waypoints"))


def _traffic(record: RunRecord) -> str:
    if not record.traffic:
        return ""
    groups = {
        "camera": ("Cameras", "delivered", "what the others got of it"),
        "robot": ("Robots", "delivered", "what the others got of it"),
        "service": ("Services", "received", "what it got"),
    }
    largest = max((line.offered for line in record.traffic), default=0) or 1
    parts = []
    for kind, (name, got, tip) in groups.items():
        lines = [line for line in record.traffic if line.kind == kind]
        rows = [
            (
                escape(line.name),
                f'<i class="bar" style="--w:{100 * line.offered / largest:.1f}%"></i>',
                human_bytes(line.offered),
                human_bytes(line.delivered),
                human_bytes(line.wire),
            )
            for line in sorted(lines, key=lambda line: (-line.offered, line.name))
        ]
        if rows:
            parts.append(
                f'<h3 title="{tip}">{name}</h3>' + _table(("name", "share", "offered#", f"{got}#", "wire#"), rows)
            )
    totals = record.totals
    parts.append(
        f'<p class="soft">In all {human_bytes(totals["offered"])} offered (what was put: payload, header and key), '
        f"{human_bytes(totals['delivered'])} delivered (what receivers got), {human_bytes(totals['wire'])} sent on the "
        "wire (the kernel's count on each node's own sockets).</p>"
    )
    return _section("Traffic", f'<div class="traffic">{"".join(parts)}</div>')


def _timeline(record: RunRecord) -> str:
    moments = [m for m in record.timeline if math.isfinite(m.t_s)]
    if not moments:
        return ""
    spans: dict[str, float] = {}
    ends = [m.t_s for m in moments[1:]] + [max(record.seconds, moments[-1].t_s)]
    for moment, end in zip(moments, ends, strict=True):
        spans[moment.phase] = spans.get(moment.phase, 0.0) + max(0.0, end - moment.t_s)
    total = sum(spans.values()) or 1.0
    colours = ("#0b63c5", "#6741d9", "#12805c", "#e8a200", "#d6336c", "#868e96", "#2b8a9b", "#a33a2b")
    bar = "".join(
        f'<i style="width:{100 * s / total:.2f}%;background:{colours[i % 8]}" title="{escape(p)}: {s:.1f} s"></i>'
        for i, (p, s) in enumerate(spans.items())
    )
    names = "".join(
        f'<li><i style="--c:{colours[i % 8]}"></i>{escape(p)} <b>{s:.1f} s</b></li>'
        for i, (p, s) in enumerate(spans.items())
    )
    shown = [m for before, m in zip([None, *moments], moments, strict=False) if before is None or before[1:] != m[1:]]
    rows = [(f"{m.t_s:.1f}", escape(m.phase), escape(m.message)) for m in shown]
    table = _fold(_table(("s#", "phase", ""), rows[:_MOST_ROWS]), len(rows), "events")
    return _section("Timeline", f'<div class="phases">{bar}</div><ul class="legend">{names}</ul>', table)


def _verdict(record: RunRecord) -> str:
    rows = []
    for name, value in record.verdict.items():
        plain = _plain(value)
        shown = "–" if plain is None else f"{plain:.3f}" if isinstance(plain, float) else str(plain)
        rows.append((escape(name), escape(shown)))
    return _section("The simulator's check", _table(("", ""), rows)) if rows else ""


def _fold(table: str, n_rows: int, what: str) -> str:
    """Long tables are folded away."""
    return table if n_rows <= 15 else f"<details><summary>{n_rows} {what}</summary>{table}</details>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Cells are HTML already. A head that ends in ``#`` is a column of numbers."""
    kinds = [' class="n"' if h.endswith("#") else "" for h in heads]
    head = "".join(f"<th{k}>{escape(h.rstrip('#'))}</th>" for h, k in zip(heads, kinds, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{k}>{c}</td>" for c, k in zip(row, kinds, strict=True)) + "</tr>" for row in rows
    )
    top = f"<thead><tr>{head}</tr></thead>" if any(heads) else ""
    return f'<div class="wide"><table>{top}<tbody>{body}</tbody></table></div>'
