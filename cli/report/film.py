"""The film strip of a search: per step the robot's view, the map so far, what was believed, what was weighed and why.

``film_of`` makes what ``film.js`` shows, as plain JSON values. All lists are bounded: so is the report's size.
"""

from __future__ import annotations

import base64
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from surveilnav.cli.report.beliefs import Belief, beliefs_of
from surveilnav.cli.report.cell_changes import GrowingMap, changes, growing_map
from surveilnav.cli.report.record import RunRecord, Step
from surveilnav.cli.report.small_pictures import small_pictures
from surveilnav.messages import Candidate, ObjectRecord, Plan

_MOST_FRAMES = 501
_PICTURES_BYTES, _MAPS_BYTES = 1_450_000, 260_000
_MOST_CANDIDATES, _NOTE_CHARS, _PATH_POINTS = 6, 120, 30


@dataclass(frozen=True, slots=True)
class Film:
    """The strip: its ``steps`` (a part of the run's, where there are many) and their ``numbers``, the ``plans`` made at them or
    before, a small picture of each (WebP, empty if there is none), the floors' maps."""

    steps: Sequence[Step]
    numbers: Sequence[int]
    plans: Sequence[Plan | None]
    pictures: Sequence[bytes]
    maps: dict[str, GrowingMap]
    beliefs: Sequence[Belief]

    def data(self, record: RunRecord) -> dict[str, Any]:
        """What the page's script gets."""
        return {
            "floors": {floor: _floor(record, floor, grown) for floor, grown in self.maps.items()},
            "target": record.target,
            "frames": self._frames(),
            "beliefs": [[b.frame, b.object_id, b.label, b.score, b.status, b.sources] for b in self.beliefs],
        }

    def _frames(self) -> list[dict[str, Any]]:
        frames = []
        shown = {floor: np.zeros(grown.grid.shape, np.uint8) for floor, grown in self.maps.items()}
        before: Plan | None = None
        start = self.steps[0]
        for step, n, plan, picture in zip(self.steps, self.numbers, self.plans, self.pictures, strict=True):
            frame: dict[str, Any] = {
                "n": n,
                "t": round(step.t_s - start.t_s, 1),
                "f": step.floor,
                "x": round(step.x_m, 2),
                "y": round(step.y_m, 2),
                "a": round(step.yaw_rad, 2),
                "d": round(step.path_m - start.path_m, 2),
            }
            if picture:
                frame["v"] = _base64(picture)
            for floor, grown in self.maps.items():
                now = grown.at(step.seq)
                if runs := changes(shown[floor], now):
                    frame.setdefault("m", {})[floor] = _base64(runs)
                    shown[floor] = now
            if plan is not None and plan is not before:
                frame["p"] = _plan(plan)
            before = plan
            frames.append(frame)
        return frames


def film_of(record: RunRecord, objects: Sequence[ObjectRecord]) -> Film | None:
    """The strip of a run, with what was believed of ``objects``; None where the robot was never seen."""
    walked = [s for s in record.trajectory if all(map(math.isfinite, (s.x_m, s.y_m, s.yaw_rad, s.t_s, s.path_m)))]
    if not walked:
        return None
    each = math.ceil(len(walked) / _MOST_FRAMES)
    steps = walked[::each] if (len(walked) - 1) % each == 0 else [*walked[::each][: _MOST_FRAMES - 1], walked[-1]]
    seqs = [plan.seq for plan in record.plans]
    latest = [bisect_right(seqs, step.seq) - 1 for step in steps]
    return Film(
        steps,
        _numbers(record, steps),
        [record.plans[i] if i >= 0 else None for i in latest],
        small_pictures([step.jpeg for step in steps], _PICTURES_BYTES),
        _maps(record, steps),
        beliefs_of(objects, steps),
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


def _maps(record: RunRecord, steps: Sequence[Step]) -> dict[str, GrowingMap]:
    """By floor; coarser where the changes would take too many bytes."""
    maps = {}
    for floor in {m.floor for m in record.map_moments} & {s.floor for s in steps}:
        moments = [m for m in record.map_moments if m.floor == floor]
        for max_cells in (60_000, 15_000, 4_000):
            if (grown := growing_map(moments, max_cells)) is None:
                break
            maps[floor] = grown
            zero = np.zeros((1, *grown.grid.shape), np.uint8)
            before = np.concatenate([zero, grown.cells[:-1]])
            if sum(len(changes(a, b)) for a, b in zip(before, grown.cells, strict=True)) <= _MAPS_BYTES:
                break
    return dict(sorted(maps.items()))


def _floor(record: RunRecord, floor: str, grown: GrowingMap) -> dict[str, Any]:
    grid = grown.grid
    cameras = [
        [c.camera, round(c.position_m[0], 2), round(c.position_m[1], 2), c.camera in record.invoked]
        for c in record.cameras[:200]
        if c.floor == floor and all(map(math.isfinite, c.position_m))
    ]
    return {
        "x": round(grid.origin_x_m, 3),
        "y": round(grid.origin_y_m, 3),
        "r": grid.resolution_m,
        "rows": grid.rows,
        "cols": grid.cols,
        "cameras": cameras,
    }


def _plan(plan: Plan) -> dict[str, Any]:
    told: dict[str, Any] = {"why": plan.why[:_NOTE_CHARS], "c": [_candidate(c) for c in weighed(plan)]}
    if plan.waypoint is not None and _is_place(plan.waypoint):
        told["w"] = _candidate(plan.waypoint)
    told["p"] = [round(v, 2) for p in _simple(plan.path_m) for v in p]
    return told


def weighed(plan: Plan) -> list[Candidate]:
    """What a plan weighed, the chosen first, then by worth; the most worthy only."""
    places = [c for c in plan.candidates if _is_place(c)]
    return sorted(places, key=lambda c: (not c.chosen, -c.score))[:_MOST_CANDIDATES]


def _candidate(c: Candidate) -> list[Any]:
    return [c.kind, round(c.x_m, 2), round(c.y_m, 2), float(f"{c.score:.2g}"), c.note[:_NOTE_CHARS], c.chosen]


def _is_place(c: Candidate) -> bool:
    return all(map(math.isfinite, (c.x_m, c.y_m, c.score)))


def _simple(path_m: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The way with the corners that matter (5 cm); no more than ``_PATH_POINTS``."""
    points = np.array([p[:2] for p in path_m if all(map(math.isfinite, p[:2]))], np.float32).reshape(-1, 2)
    if len(points) < 2:
        return []
    kept = cv2.approxPolyDP(points.reshape(-1, 1, 2), 0.05, False).reshape(-1, 2)[:_PATH_POINTS]
    return [(float(x), float(y)) for x, y in kept]


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
