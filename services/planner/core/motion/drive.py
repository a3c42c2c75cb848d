"""The local planner: from a travel-time field to a discrete action and a path to show."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.motion.terrain import Terrain, travel_time_m
from surveilnav.services.planner.core.state import RobotView

#: Headings that the robot can turn to, in turns: left positive, a full circle.
HEADINGS = np.arange(-5, 7)


@dataclass(frozen=True, slots=True)
class Route:
    """A way to a goal: the next action, (x, y) points [m] from the robot to the goal, and the travel time [m]."""

    action: str
    path: tuple[tuple[float, float], ...]
    remaining_m: float


class LocalPlanner(Protocol):
    """Drives to the nearest of some goal cells. ``FmmPlanner`` knows only the map; one that knows the building may stand in."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig
    ) -> Route | None:
        """The next action towards ``goals`` (bool of the terrain's shape), or None if no way leads there."""


class FmmPlanner:
    """The paper's planner: Fast Marching from the goal over the known map."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig
    ) -> Route | None:
        """See ``LocalPlanner``. The field falls all the way to the goal: nothing to get caught in.

        The front runs a little farther than to the robot: as far as it may have to step aside.
        """
        here = terrain.cell(robot.x_m, robot.y_m)
        field = travel_time_m(steered(terrain.speed), goals, terrain.grid.resolution_m, here, _ASIDE_M)
        if not math.isfinite(field[here]):
            return None
        return Route(next_action(terrain, field, robot, config), descend(terrain, field, *here), float(field[here]))


def steered(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """(rows, cols) the speed that a robot of twelve headings keeps: of the passable cells around each, the mean slowness.

    It can't keep to the middle of a passage by less than a cell. A field that takes it that it can makes steps into narrow
    passages dearer than it promises, and the robot paces before them for ever.
    """
    passable = (speed > 0.0).astype(np.float64)
    slowness = np.divide(1.0, speed, out=np.zeros_like(speed), where=speed > 0.0)
    around, total = (cv2.blur(a, (3, 3), borderType=cv2.BORDER_CONSTANT) for a in (passable, slowness))
    return np.asarray(np.divide(around, total, out=np.zeros_like(speed), where=speed > 0.0))


#: Travel time [m] beyond the robot that the field covers.
_ASIDE_M = 2.0
#: Steps that are looked ahead, ends of steps that are looked at for it, and how many a cell's length tells apart.
_AHEAD = 6
_MOST_ENDS = 3000
_PER_CELL = 2.0
#: A bump is remembered for this spot and this heading only.
_SAME_SPOT_M = 0.03
_SAME_HEADING_COS = math.cos(math.radians(10.0))


def next_action(terrain: Terrain, field: NDArray[np.float64], robot: RobotView, config: PlannerConfig) -> str:
    """Turns to, or drives along, the heading that begins the steps which end nearest to the goal.

    A robot that turns by twelfths and moves by whole steps can't follow any path: of all sequences of up to
    ``_AHEAD`` free steps, A* finds the one with the least travel time, its own and what the field says is left at its
    end, plus a small price per turn. Looking so far ahead takes the robot through narrow places, in front of which the
    single best step would lead to and fro. The price makes the choice stable: a turn towards the best sequence makes
    that cheaper and no other cheaper still, so the robot never swings. A step costs its own travel time: one that
    squeezes past an obstacle must be worth more than one around it. Rounds of several places, each of which looks better
    from the one before, are broken by the price of what is visited again and again (``Terrain.revisit_m``).
    """
    grid, r = terrain.grid, terrain.grid.resolution_m
    u, v = (robot.x_m - grid.origin_x_m) / r, (robot.y_m - grid.origin_y_m) / r
    bumps = (terrain.bumps - (grid.origin_x_m, grid.origin_y_m, 0.0)) / (r, r, 1.0)
    best = int(
        _look_ahead(
            terrain.speed,
            field / r,
            terrain.revisit_m / r,
            u,
            v,
            robot.yaw_rad,
            bumps,
            config.step_m / r,
            config.turn_rad,
            config.turn_cost_m / r,
            _SAME_SPOT_M / r,
        )
    )
    return "move_forward" if best == 0 else "turn_left" if best > 0 else "turn_right"


@njit(cache=True)  # type: ignore[untyped-decorator]
def _look_ahead(speed, field, revisit, u, v, yaw, bumps, step, turn, turn_cost, same_spot):  # type: ignore[no-untyped-def]
    """Turns before the first step of the best sequence; lengths in cells. Of sequences that end at the goal or are
    ``_AHEAD`` steps long the best counts, else the longest; where not even one step is free, the heading that is blocked
    latest is taken."""
    reach = int(_AHEAD * step * _PER_CELL) + 2
    been = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.bool_)
    clearest, least_blocked, best, farthest = -1.0, 0, 0, 0
    # (travel time through this end, number, time spent, u, v, heading, steps, turns before the first)
    queue = [(0.0, 0, 0.0, u, v, yaw, 0, 0)]
    pushed, popped = 1, 0
    while len(queue) > 0 and popped < _MOST_ENDS:
        _, _, spent, u0, v0, heading, steps, first = heapq.heappop(queue)
        row, col = int((v0 - v) * _PER_CELL + reach + 0.5), int((u0 - u) * _PER_CELL + reach + 0.5)
        if been[row, col]:
            continue
        been[row, col] = True
        popped += 1
        if steps > farthest:
            best, farthest = first, steps
        if steps == _AHEAD or (steps > 0 and _at(field, u0, v0) <= step):
            return first
        for k in range(len(HEADINGS)):
            i = int(HEADINGS[k])
            u1, v1, clear, time = _stride(speed, u0, v0, heading + i * turn, bumps, step, same_spot)
            if steps == 0 and clear - turn_cost / step * abs(i) > clearest:
                clearest, least_blocked = clear - turn_cost / step * abs(i), i
            left = _at(field, u1, v1) if clear >= 1.0 else np.inf
            if left == np.inf:
                continue
            time += spent + turn_cost * abs(i) + revisit[int(v1), int(u1)]
            end = time + left, pushed, time, u1, v1, heading + i * turn, steps + 1, first if steps else i
            heapq.heappush(queue, end)
            pushed += 1
    return best if farthest > 0 else least_blocked


@njit(cache=True)  # type: ignore[untyped-decorator]
def _stride(speed, u, v, yaw, bumps, step, same_spot):  # type: ignore[no-untyped-def]
    """Where a step ends, which share of it is free (none where the robot met something from this spot), and its travel
    time: a step through a tight place most likely ends there, and is as dear as there. Every cell that it crosses counts,
    as it does for the body (Amanatides & Woo 1987)."""
    c, s = math.cos(yaw), math.sin(yaw)
    for b in range(len(bumps)):
        if math.hypot(bumps[b, 0] - u, bumps[b, 1] - v) < same_spot and math.cos(yaw - bumps[b, 2]) > _SAME_HEADING_COS:
            return u, v, 0.0, np.inf
    du, dv = c * step, s * step
    row, col = math.floor(v), math.floor(u)
    to_row, to_col = (1 if dv > 0.0 else -1), (1 if du > 0.0 else -1)
    # shares of the step at which it crosses the next row's and the next column's edge
    next_row = ((row + 1 - v) if dv > 0.0 else (row - v)) / dv if dv != 0.0 else np.inf
    next_col = ((col + 1 - u) if du > 0.0 else (col - u)) / du if du != 0.0 else np.inf
    share, time = 0.0, 0.0
    while _open(speed, row, col):
        ahead = min(next_row, next_col, 1.0)
        time += (ahead - share) * step / speed[row, col]
        share = ahead
        if share >= 1.0:
            return u + du, v + dv, 1.0, time
        if abs(next_row - next_col) < 1e-9:  # through a corner: both cells beside it must be open
            if not (_open(speed, row + to_row, col) and _open(speed, row, col + to_col)):
                break
            row, col = row + to_row, col + to_col
            next_row, next_col = next_row + 1.0 / abs(dv), next_col + 1.0 / abs(du)
        elif next_row < next_col:
            row, next_row = row + to_row, next_row + 1.0 / abs(dv)
        else:
            col, next_col = col + to_col, next_col + 1.0 / abs(du)
    return u, v, share, np.inf


@njit(cache=True)  # type: ignore[untyped-decorator]
def _open(speed, row, col):  # type: ignore[no-untyped-def]
    return 0 <= row < speed.shape[0] and 0 <= col < speed.shape[1] and speed[row, col] > 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _at(field, u, v):  # type: ignore[no-untyped-def]
    """The field at a place [cells], bilinear over its finite neighbours; inf where the place's own cell is."""
    rows, cols = field.shape
    if field[int(v), int(u)] == np.inf:
        return np.inf
    y, x = min(max(v - 0.5, 0.0), rows - 1.0), min(max(u - 0.5, 0.0), cols - 1.0)
    row, col = min(int(y), rows - 2), min(int(x), cols - 2)
    total = weights = 0.0
    for dr in range(2):
        for dc in range(2):
            value = field[row + dr, col + dc]
            if value < np.inf:
                weight = (y - row if dr else 1.0 - y + row) * (x - col if dc else 1.0 - x + col)
                total, weights = total + weight * value, weights + weight
    return total / weights if weights > 0.0 else np.inf


def descend(terrain: Terrain, field: NDArray[np.float64], row: int, col: int) -> tuple[tuple[float, float], ...]:
    """(x, y) [m] from a cell down the field to its source, a point every other cell or so."""
    cells = _descent(field, row, col)
    kept = np.concatenate([cells[:-1:2], cells[-1:]])
    return tuple((float(x), float(y)) for x, y in terrain.grid.centres_of(kept))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _descent(field, row, col):  # type: ignore[no-untyped-def]
    """Cells (n, 2) from one to the source: always the lowest of the eight neighbours; a diagonal one counts only if both
    cells beside it are open, so the path never cuts a corner."""
    rows, cols = field.shape
    cells = [(row, col)]
    while field[row, col] > 0.0:
        best, best_row, best_col = field[row, col], row, col
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for c in range(max(0, col - 1), min(cols, col + 2)):
                beside = np.isfinite(field[r, col]) and np.isfinite(field[row, c])
                if field[r, c] < best and beside:
                    best, best_row, best_col = field[r, c], r, c
        if (best_row, best_col) == (row, col):
            break
        row, col = best_row, best_col
        cells.append((row, col))
    return np.array(cells)


def turn_towards(robot: RobotView, x_m: float, y_m: float, config: PlannerConfig) -> str | None:
    """The turn that brings a place ahead, or None if it is ahead already (within half a turn)."""
    error = bearing_error_rad(robot, x_m, y_m)
    if abs(error) <= config.turn_rad / 2 + 1e-6:
        return None
    return "turn_left" if error > 0 else "turn_right"


def bearing_error_rad(robot: RobotView, x_m: float, y_m: float) -> float:
    """How far left (> 0) of the robot's heading a place lies, in (-pi, pi]."""
    bearing = math.atan2(y_m - robot.y_m, x_m - robot.x_m)
    return math.remainder(bearing - robot.yaw_rad, 2.0 * math.pi)
