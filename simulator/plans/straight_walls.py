"""The straight walls that a plan's walls consist of: arcs cut into chords, heights along them, who joins whom."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surveilnav.simulator.plans.plan import Opening, Wall
from surveilnav.simulator.plans.sweethome import PlanWall

#: An arc wall becomes straight pieces that span at most this angle.
_ARC_STEP_RAD = math.pi / 16


class WallPart(NamedTuple):
    """A straight part of a wall of the plan."""

    plan: PlanWall
    start: tuple[float, float]
    end: tuple[float, float]
    height_m: float
    end_height_m: float


def parts_of(plan: PlanWall, level_height_m: float) -> list[WallPart]:
    """The straight walls that a wall of the plan consists of, start to end."""
    height = plan.height_m if plan.height_m is not None else level_height_m
    end_height = plan.end_height_m if plan.end_height_m is not None else height
    points = arc_points(plan) if plan.arc_rad else [plan.start_m, plan.end_m]
    count = len(points) - 1
    heights = [height + (end_height - height) * i / count for i in range(count + 1)]
    return [WallPart(plan, points[i], points[i + 1], heights[i], heights[i + 1]) for i in range(count)]


def joined(parts: Sequence[WallPart], candidates: Sequence[int], here: tuple[float, float]) -> int | None:
    """The candidate with an end nearest to ``here``, or None where there is no candidate."""
    if not candidates:
        return None
    return min(candidates, key=lambda k: min(math.dist(here, parts[k].start), math.dist(here, parts[k].end)))


def near(wall: Wall, openings: Sequence[Opening]) -> list[Opening]:
    """The openings that may touch a wall at all (a quick test)."""
    if not openings:
        return []
    a, along = np.array(wall.start_m), np.array(wall.end_m) - np.array(wall.start_m)
    p = np.array([o.centre_m for o in openings])
    t = np.clip((p - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    reach = np.array([o.width_m / 2 + o.depth_m for o in openings]) + wall.thickness_m
    near = np.linalg.norm(a + t[:, None] * along - p, axis=1) < reach
    return [openings[int(i)] for i in np.flatnonzero(near)]


def arc_points(wall: PlanWall) -> list[tuple[float, float]]:
    """Points along an arc wall's centre line (``Wall.computeArcCircleCenter`` in Sweet Home 3D), start to end."""
    # In the plan's own frame: y down, the arc's angle clockwise.
    (xs, ys), (xe, ye), extent = (wall.start_m[0], -wall.start_m[1]), (wall.end_m[0], -wall.end_m[1]), -wall.arc_rad
    chord = math.dist((xs, ys), (xe, ye))
    if chord < 1e-6 or abs(extent) < 1e-3:
        return [wall.start_m, wall.end_m]
    to_center = -(math.pi + extent) / 2 if abs(extent) > math.pi else (math.pi - extent) / 2
    distance = -math.tan(to_center) * chord / 2
    normal = math.atan2(xs - xe, ye - ys)
    cx, cy = (xs + xe) / 2 + distance * math.cos(normal), (ys + ye) / 2 + distance * math.sin(normal)
    radius, first = math.hypot(xs - cx, ys - cy), math.atan2(ys - cy, xs - cx)

    def miss(turn_rad: float) -> float:
        return math.dist((cx + radius * math.cos(first + turn_rad), cy + radius * math.sin(first + turn_rad)), (xe, ye))

    turn_rad = min((extent, -extent), key=miss)
    count = max(4, math.ceil(abs(turn_rad) / _ARC_STEP_RAD))
    angles = [first + turn_rad * i / count for i in range(count + 1)]
    points = [(cx + radius * math.cos(a), -(cy + radius * math.sin(a))) for a in angles]
    points[0], points[-1] = wall.start_m, wall.end_m
    return points
