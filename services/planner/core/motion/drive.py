"""The local planner: from a field of travel times to the next discrete action, and the path to show."""

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
from surveilnav.services.planner.core.inputs import RobotView
from surveilnav.services.planner.core.motion.terrain import Terrain, travel_time_m

#: Headings that the robot can turn to, in turns from its own: left is positive, together a full circle.
HEADINGS = np.arange(-5, 7)


@dataclass(frozen=True, slots=True)
class Route:
    """A way to a goal: the next action, the path as (x, y) points [m] from the robot on, and the travel time left [m]."""

    action: str
    path: tuple[tuple[float, float], ...]
    remaining_m: float


class LocalPlanner(Protocol):
    """Drives to the nearest of some goal cells. Ours is ``FmmPlanner``; the benchmark also has one that knows the building."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig
    ) -> Route | None:
        """Plans towards ``goals`` (bool of the terrain's shape). Returns None if no way leads there."""


class FmmPlanner:
    """The paper's planner: Fast Marching from the goal cells over the known map."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig
    ) -> Route | None:
        """See ``LocalPlanner``. The travel time has no local minima but the goals, so the robot can't get caught.

        The field is computed a little beyond the robot, as far as it may have to step aside.
        """
        here = terrain.cell(robot.x_m, robot.y_m)
        field = travel_time_m(steering_speed(terrain.speed), goals, terrain.grid.resolution_m, [[here]], BEYOND_ROBOT_M)
        if not math.isfinite(field[here]):
            return None
        action = next_action(terrain, field, robot, config)
        if action == "move_forward" and _enters_barred(terrain, robot, config):
            action = "turn_left"  # no step is free; unlike a wall, nothing there would stop the robot
        return Route(action, descend(terrain, field, *here), float(field[here]))


def _enters_barred(terrain: Terrain, robot: RobotView, config: PlannerConfig) -> bool:
    """Whether a step straight on enters cells where the robot isn't sent, other than those on its way out of there."""
    if terrain.barred is None:
        return False
    along_m = np.linspace(0.0, config.step_m, 16)[1:, None]
    heading = np.array([math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)])
    cells = terrain.grid.cells_of((robot.x_m, robot.y_m) + along_m * heading)
    cells = cells[terrain.grid.contains(cells)]
    return bool((terrain.barred.near & (terrain.speed <= 0.0))[cells[:, 0], cells[:, 1]].any())


def steering_speed(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """(rows, cols) the speed that a robot with twelve headings can keep: the harmonic mean over the passable cells around each.

    Such a robot can't keep to the middle of a passage to within a cell. If the field assumed that it can, steps into narrow
    passages would cost more than the field promises, and the robot would pace up and down in front of them.
    """
    passable = (speed > 0.0).astype(np.float64)
    slowness = np.divide(1.0, speed, out=np.zeros_like(speed), where=speed > 0.0)
    around, total = (cv2.blur(a, (3, 3), borderType=cv2.BORDER_CONSTANT) for a in (passable, slowness))
    return np.asarray(np.divide(around, total, out=np.zeros_like(speed), where=speed > 0.0))


#: The field is computed to this travel time [m] beyond the robot.
BEYOND_ROBOT_M = 2.0
#: Length of the sequences of steps that are compared.
_LOOKAHEAD_STEPS = 6
#: At most so many ends of steps are expanded.
_MAX_NODES = 3000
#: Ends of steps are told apart at this resolution.
_NODES_PER_CELL = 2.0
#: A bump counts only for this place and this heading.
_SAME_SPOT_M = 0.03
_SAME_HEADING_COS = math.cos(math.radians(10.0))


def next_action(terrain: Terrain, field: NDArray[np.float64], robot: RobotView, config: PlannerConfig) -> str:
    """The action that begins the best sequence of steps: turns to the heading of its first step, or drives along it.

    A robot that turns by twelfths and moves by whole steps can't follow just any path. So A* searches all sequences of up to
    ``_LOOKAHEAD_STEPS`` free steps for the one with the least cost: the travel time of its steps, what the field says is left
    at its end, and a small cost per turn.

    - Looking several steps ahead gets the robot through narrow places, in front of which the single best step would lead to
      and fro.
    - The cost per turn makes the choice stable: a turn towards the best sequence makes that one cheaper, and no other one by
      more, so the robot never swings.
    - A step costs its own travel time, so one that squeezes past an obstacle is taken only if it saves more than that.
    - Cycles of places, each of which looks better from the one before, are broken by the cost of revisiting
      (``Terrain.revisit_m``).
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
    """Turns before the first step of the best sequence; lengths in cells.

    The best sequence is the cheapest that ends at the goal or is ``_LOOKAHEAD_STEPS`` steps long; if there is none, the
    longest; and if not even one step is free, the one whose first step gets farthest.
    """
    radius = int(_LOOKAHEAD_STEPS * step * _NODES_PER_CELL) + 2
    visited = np.zeros((2 * radius + 1, 2 * radius + 1), dtype=np.bool_)
    clearest, least_blocked, best, farthest = -1.0, 0, 0, 0
    # (travel time through this end, number, time spent, u, v, heading, steps, turns before the first)
    queue = [(0.0, 0, 0.0, u, v, yaw, 0, 0)]
    pushed, popped = 1, 0
    while len(queue) > 0 and popped < _MAX_NODES:
        _, _, spent, u0, v0, heading, steps, first = heapq.heappop(queue)
        row, col = int((v0 - v) * _NODES_PER_CELL + radius + 0.5), int((u0 - u) * _NODES_PER_CELL + radius + 0.5)
        if visited[row, col]:
            continue
        visited[row, col] = True
        popped += 1
        if steps > farthest:
            best, farthest = first, steps
        if steps == _LOOKAHEAD_STEPS or (steps > 0 and _interpolate(field, u0, v0) <= step):
            return first
        for k in range(len(HEADINGS)):
            i = int(HEADINGS[k])
            u1, v1, clear, time = _try_step(speed, u0, v0, heading + i * turn, bumps, step, same_spot)
            if steps == 0 and clear - turn_cost / step * abs(i) > clearest:
                clearest, least_blocked = clear - turn_cost / step * abs(i), i
            left = _interpolate(field, u1, v1) if clear >= 1.0 else np.inf
            if left == np.inf:
                continue
            time += spent + turn_cost * abs(i) + revisit[int(v1), int(u1)]
            end = time + left, pushed, time, u1, v1, heading + i * turn, steps + 1, first if steps else i
            heapq.heappush(queue, end)
            pushed += 1
    return best if farthest > 0 else least_blocked


@njit(cache=True)  # type: ignore[untyped-decorator]
def _try_step(speed, u, v, yaw, bumps, step, same_spot):  # type: ignore[no-untyped-def]
    """Where a step ends (u, v) [cells], which share of it is free, and its travel time.

    Nothing of it is free if the robot bumped into something from this place in this heading. All cells that the step crosses
    count (Amanatides & Woo 1987), as they do for the robot's body.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    for b in range(len(bumps)):
        if math.hypot(bumps[b, 0] - u, bumps[b, 1] - v) < same_spot and math.cos(yaw - bumps[b, 2]) > _SAME_HEADING_COS:
            return u, v, 0.0, np.inf
    du, dv = c * step, s * step
    row, col = math.floor(v), math.floor(u)
    to_row, to_col = (1 if dv > 0.0 else -1), (1 if du > 0.0 else -1)
    # the shares of the step at which it enters the next row and the next column
    next_row = ((row + 1 - v) if dv > 0.0 else (row - v)) / dv if dv != 0.0 else np.inf
    next_col = ((col + 1 - u) if du > 0.0 else (col - u)) / du if du != 0.0 else np.inf
    share, time = 0.0, 0.0
    while _is_open(speed, row, col):
        ahead = min(next_row, next_col, 1.0)
        time += (ahead - share) * step / speed[row, col]
        share = ahead
        if share >= 1.0:
            return u + du, v + dv, 1.0, time
        if abs(next_row - next_col) < 1e-9:  # through a corner: both cells beside it must be open
            if not (_is_open(speed, row + to_row, col) and _is_open(speed, row, col + to_col)):
                break
            row, col = row + to_row, col + to_col
            next_row, next_col = next_row + 1.0 / abs(dv), next_col + 1.0 / abs(du)
        elif next_row < next_col:
            row, next_row = row + to_row, next_row + 1.0 / abs(dv)
        else:
            col, next_col = col + to_col, next_col + 1.0 / abs(du)
    return u, v, share, np.inf


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_open(speed, row, col):  # type: ignore[no-untyped-def]
    return 0 <= row < speed.shape[0] and 0 <= col < speed.shape[1] and speed[row, col] > 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _interpolate(field, u, v):  # type: ignore[no-untyped-def]
    """The field at a place [cells], bilinear over its finite neighbours; inf if it is in the place's own cell."""
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
    """The path (x, y) [m] from a cell down the field to its source, with a point at every other cell."""
    cells = _descent(field, row, col)
    kept = np.concatenate([cells[:-1:2], cells[-1:]])
    return tuple((float(x), float(y)) for x, y in terrain.grid.centres_of(kept))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _descent(field, row, col):  # type: ignore[no-untyped-def]
    """Cells (n, 2) from one to the source, by steepest descent over the eight neighbours.

    A diagonal step is taken only if both cells beside it are open, so the path never cuts a corner.
    """
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
    """The turn that brings a place ahead; None if it is ahead already, within half a turn."""
    error = bearing_error_rad(robot, x_m, y_m)
    if abs(error) <= config.turn_rad / 2 + 1e-6:
        return None
    return "turn_left" if error > 0 else "turn_right"


def bearing_error_rad(robot: RobotView, x_m: float, y_m: float) -> float:
    """How far left (> 0) of the robot's heading a place lies, in (-pi, pi]."""
    bearing = math.atan2(y_m - robot.y_m, x_m - robot.x_m)
    return math.remainder(bearing - robot.yaw_rad, 2.0 * math.pi)
