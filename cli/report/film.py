"""The film of a search, step by step: the robot's view, the map and the objects as they were then, what was weighed and why.

``Film.data`` gives ``report.js`` what it shows, as JSON values by the names that the gateway's REST has for them. All lists are
bounded: so is the report's size.
"""

from __future__ import annotations

import base64
import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.cli.report.record import MapMoment, RunRecord, Step, candidates_of, plain
from surveilnav.cli.report.small_pictures import small_pictures
from surveilnav.geometry import Grid
from surveilnav.messages import CameraInfo, Candidate, ObjectEvent, ObjectRecord, Plan
from surveilnav.services.gateway.core.camera_views import floor_outline
from surveilnav.services.gateway.core.layers import render

_MAX_FRAMES = 501
_PICTURES_BYTES, _MAPS_BYTES = 1_100_000, 260_000
#: Layers with more cells are shown with several cells joined.
_MAX_CELLS = 60_000
_MAX_CANDIDATES, _NOTE_CHARS, _WHY_CHARS, _PATH_POINTS = 6, 100, 200, 20
_MAX_CAMERAS, _MAX_OBJECTS, _MAX_SIGHTINGS, _MAX_EVENTS, _MAX_SOURCES = 200, 100, 1500, 60, 6
#: Events that change how sure the maps are of an object.
_STATUS = {"created": "candidate", "confirmed": "confirmed", "rejected": "rejected", "flipped": "candidate"}


class Sighting(NamedTuple):
    """What is known of an object (by its place in the list) from a frame on. ``sources``: who had seen it, the first first."""

    frame: int
    number: int
    status: str
    label: str
    confidence: float | None
    sources: tuple[str, ...]

    @property
    def seen_by(self) -> str:
        """The sources in words."""
        return ", ".join(map(_in_words, self.sources))


@dataclass(frozen=True, slots=True)
class Film:
    """What is shown of a run, a frame for each of its ``steps`` (of a part of them, where there are many).

    Attributes:
        numbers: how many steps the planner had counted at each frame.
        plans: the newest plan at each frame.
        pictures: what the robot saw at each frame; WebP, empty if no picture is kept.
        objects, sightings: the objects that are shown, and what was known of them from which frame on.
    """

    steps: Sequence[Step]
    numbers: Sequence[int]
    plans: Sequence[Plan | None]
    pictures: Sequence[bytes]
    objects: Sequence[ObjectRecord]
    sightings: Sequence[Sighting]

    def data(self, record: RunRecord) -> dict[str, Any]:
        """What the page's script gets."""
        robot = record.status.robot if record.status is not None else "robot"
        return {
            "building": record.building,
            "target": record.target,
            "robot": robot,
            "frames": list(self._frames()),
            "cameras": [_camera(c, record) for c in record.cameras[:_MAX_CAMERAS] if _finite(*c.position_m)],
            "objects": [_object(o) for o in self.objects],
            "sightings": [[*s[:5], list(s.sources)] for s in self.sightings],
            "maps": self._maps(record.map_moments),
            "layers": {
                floor: {name: drawn for name, (grid, cells) in layers.items() if (drawn := _layer(name, grid, cells))}
                for floor, layers in record.layers.items()
            },
        }

    def _frames(self) -> Iterator[dict[str, Any]]:
        before: Plan | None = None
        start = self.steps[0]
        for step, number, plan, picture in zip(self.steps, self.numbers, self.plans, self.pictures, strict=True):
            frame: dict[str, Any] = {
                "step": number,
                "t_s": round(step.t_s - start.t_s, 1),
                "floor": step.floor,
                "position_m": [round(step.x_m, 2), round(step.y_m, 2)],
                "yaw_rad": round(step.yaw_rad, 2),
                "path_m": round(step.path_m - start.path_m, 2),
            }
            if picture:
                frame["picture"] = _base64(picture)
            if plan is not None and plan is not before:
                frame["plan"] = _plan(plan)
            before = plan
            yield frame

    def _maps(self, moments: Sequence[MapMoment]) -> list[dict[str, Any]]:
        """What was explored and what is an obstacle, from which frame on; every second or third where all are too large."""
        maps = [drawn for moment in moments if (drawn := self._map(moment))]
        total = sum(len(layer["png"]) for drawn in maps for layer in drawn["layers"].values())
        return maps[:: -max(1, math.ceil(total / _MAPS_BYTES))][::-1]

    def _map(self, moment: MapMoment) -> dict[str, Any] | None:
        cells = moment.cells
        drawn = {
            "explored": _layer("explored", moment.grid, np.asarray(cells > 0, np.uint8)),
            "occupancy": _layer("occupancy", moment.grid, np.asarray(cells == 2, np.uint8)),
        }
        frame = min(bisect_left([step.seq for step in self.steps], moment.seq), len(self.steps) - 1)
        layers = {name: layer for name, layer in drawn.items() if layer}
        return {"frame": frame, "floor": moment.floor, "layers": layers} if layers else None


def film_of(record: RunRecord) -> Film | None:
    """The film of a run; None where the robot was never seen."""
    walked = [s for s in record.trajectory if _finite(s.x_m, s.y_m, s.yaw_rad, s.t_s, s.path_m)]
    if not walked:
        return None
    each = math.ceil(len(walked) / _MAX_FRAMES)
    steps = walked[::each] if (len(walked) - 1) % each == 0 else [*walked[::each][: _MAX_FRAMES - 1], walked[-1]]
    seqs = [plan.seq for plan in record.plans]
    latest = [bisect_right(seqs, step.seq) - 1 for step in steps]
    first = candidates_of(record)
    others = [o for o in record.objects if o not in first]
    objects = [*first, *others][:_MAX_OBJECTS]
    return Film(
        steps,
        _numbers(record, steps),
        [record.plans[i] if i >= 0 else None for i in latest],
        small_pictures([step.jpeg for step in steps], _PICTURES_BYTES),
        objects,
        _sightings(objects, steps),
    )


def _numbers(record: RunRecord, steps: Sequence[Step]) -> list[int]:
    """How many steps the planner had counted at each: a stair counts as several."""
    counted = {plan.seq: plan.step for plan in record.plans}
    numbers = [counted.get(steps[0].seq, 0)]
    for before, step in pairwise(steps):
        numbers.append(counted.get(step.seq, numbers[-1] + step.seq - before.seq))
    if record.status is not None:
        numbers[-1] = max(numbers[-1], record.status.step)
    return numbers


# --- objects ------------------------------------------------------------------------------------------------------


def _sightings(objects: Sequence[ObjectRecord], steps: Sequence[Step]) -> list[Sighting]:
    """What changed about the objects, in the order of frames; in the last frame they are as they were at the end."""
    stamps = [step.stamp_ns for step in steps]
    changes = [s for n, o in enumerate(objects) for s in _of_object(n, o, stamps)]
    last = len(steps) - 1
    ended = [
        Sighting(last, n, o.status, o.label, plain(o.confidence), tuple(o.sources[:_MAX_SOURCES]))
        for n, o in enumerate(objects)
    ]
    return [*sorted(changes[:_MAX_SIGHTINGS], key=lambda s: s.frame), *ended]


def _of_object(number: int, record: ObjectRecord, stamps: Sequence[int]) -> list[Sighting]:
    best, status, sources, known_ns = 0.0, "candidate", dict[str, None](), 0
    found: list[Sighting] = []
    for event in record.history:
        # A history's order is that of becoming known; a view that waited in a queue was taken earlier than it was known.
        known_ns = max(known_ns, event.stamp_ns)
        frame = min(bisect_left(stamps, known_ns), len(stamps) - 1)
        if event.what != "not_seen":
            best = max(best, event.score) if math.isfinite(event.score) else best
            sources[event.source] = None
        status = _STATUS.get(event.what, status)
        seen = tuple(sources)[:_MAX_SOURCES]
        sighting = Sighting(frame, number, status, event.label or record.label, round(best, 2), seen)
        if found and found[-1].frame == frame:
            found.pop()
        if not found or found[-1][1:] != sighting[1:]:
            found.append(sighting)
    return found


def _in_words(source: str) -> str:
    kind, _, name = source.partition("/")
    return "the robot" if kind == "robot" else f"{kind} {name}" if name else source


def _object(o: ObjectRecord) -> dict[str, Any]:
    """As ``GET /api/v1/floors/{floor}/objects/{id}`` tells of it; of long histories the first events and the newest."""
    history = o.history if len(o.history) <= _MAX_EVENTS else [*o.history[:20], *o.history[20 - _MAX_EVENTS :]]
    names = "id floor label status reason confidence confidence_robot confidence_surveillance label_robot label_surveillance"
    facts: dict[str, Any] = plain({n: getattr(o, n) for n in (*names.split(), "n_detections", "center_m", "size_m")})
    return facts | {
        "sources": o.sources[:_MAX_SOURCES],
        "first_seen": _time(o.first_seen_ns),
        "history": [_event(e) for e in history],
    }


def _event(e: ObjectEvent) -> dict[str, Any]:
    """Without its box: the report keeps no pictures of histories."""
    facts: dict[str, Any] = plain({n: getattr(e, n) for n in ("source", "view", "label", "score", "what", "note")})
    return facts | {"time": _time(e.stamp_ns), "box_px": None}


def _time(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns / 1e9, UTC).isoformat()


# --- cameras, plans, maps -----------------------------------------------------------------------------------------


def _camera(info: CameraInfo, record: RunRecord) -> dict[str, Any]:
    """As ``GET /api/v1/cameras/{id}`` tells of it, with what its views look at on the floor."""
    floor_z_m, invoked = info.position_m[2] - info.mounting_offset_m, info.camera in record.invoked
    return {
        "id": info.camera,
        "floor": info.floor,
        "position_m": list(info.position_m),
        "invoked": invoked,
        "views": [v.view for v in info.views],
        "views_processed": len(info.views) if invoked else 0,
        "cones": [{"outline_m": floor_outline(v.T_world_camera, info.intrinsics, floor_z_m)} for v in info.views],
    }


def _plan(plan: Plan) -> dict[str, Any]:
    """As ``GET /api/v1/missions/{id}/plan`` tells of it: the chosen place first, then the best."""
    w = plan.waypoint if plan.waypoint is not None and _is_place(plan.waypoint) else None
    places = sorted((c for c in plan.candidates if _is_place(c)), key=lambda c: (not c.chosen, -c.utility))
    return {
        "why": plan.why[:_WHY_CHARS],
        "waypoint": _candidate(w) if w else None,
        "candidates": [_candidate(c) for c in places[:_MAX_CANDIDATES]],
        "path_m": [[round(v, 2) for v in p] for p in _simplified(plan.path_m)],
    }


def _candidate(c: Candidate) -> dict[str, Any]:
    return {
        "kind": c.kind,
        "x_m": round(c.x_m, 2),
        "y_m": round(c.y_m, 2),
        "chance": None if c.chance is None else round(c.chance, 3),
        "cost_m": None if c.cost_m is None else round(c.cost_m, 1),
        "utility": float(f"{c.utility:.2g}"),
        "note": c.note[:_NOTE_CHARS],
        "chosen": c.chosen,
        "object_id": c.object_id,
    }


def _is_place(c: Candidate) -> bool:
    return _finite(c.x_m, c.y_m, c.utility, c.chance or 0.0, c.cost_m or 0.0)


def _simplified(path_m: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The way with the corners that matter (5 cm); no more than ``_PATH_POINTS``."""
    points = np.array([p[:2] for p in path_m if _finite(*p[:2])], np.float32).reshape(-1, 2)
    if len(points) < 2:
        return []
    kept = cv2.approxPolyDP(points.reshape(-1, 1, 2), 0.05, False).reshape(-1, 2)[:_PATH_POINTS]
    return [(float(x), float(y)) for x, y in kept]


def _layer(name: str, grid: Grid, cells: NDArray) -> dict[str, Any] | None:
    """The picture of a layer as the gateway serves it, cut to what is known; None where that is nothing."""
    known = np.isfinite(cells) if name == "value" else cells != 0
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    cut = cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    r = grid.resolution_m
    shown = Grid(grid.origin_x_m + cols[0] * r, grid.origin_y_m + rows[0] * r, r, *cut.shape)
    drawn = render(name, shown, cut, _MAX_CELLS)
    g = drawn.grid
    box = [float(g.origin_x_m), float(g.origin_y_m), g.resolution_m, g.rows, g.cols]
    return {"png": _base64(drawn.data), "grid": box, "range": None if drawn.low is None else [drawn.low, drawn.high]}


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
