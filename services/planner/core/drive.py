"""The local planner: from a travel-time field to a discrete action and a path to show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from services.planner.core.settings import PlannerConfig
from services.planner.core.state import RobotView
from services.planner.core.terrain import UNREACHED, Terrain, arrival_m

#: Headings that the robot can turn to, in turns: left positive, a full circle.
HEADINGS = np.arange(-5, 7)


@dataclass(frozen=True, slots=True)
class Route:
    """A way to a goal: the next action, (x, y) points [m] from the robot to the goal, and the travel time [m]."""

    action: str
    path: tuple[tuple[float, float], ...]
    remaining_m: float


class LocalPlanner(Protocol):
    """Drives to the nearest of some goal cells. ``FmmPlanner`` knows only the map; an oracle can stand in for it."""

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
        field = arrival_m(terrain.speed, goals, terrain.grid.resolution_m, here, _ASIDE_M)
        if not math.isfinite(field[here]):
            return None
        return Route(next_action(terrain, field, robot, config), descend(terrain, field, *here), float(field[here]))


#: Travel time [m] beyond the robot that the field covers.
_ASIDE_M = 2.0
#: A bump is remembered for this spot and this heading only.
_SAME_SPOT_M = 0.03
_SAME_HEADING_COS = math.cos(math.radians(10.0))


def next_action(terrain: Terrain, field: NDArray[np.float64], robot: RobotView, config: PlannerConfig) -> str:
    """Turns to, or drives along, the heading whose next step ends nearest to the goal.

    Of the twelve headings that the robot can turn to, those with a free step ahead compete by travel time left at
    the step's end plus a small price per turn. The price makes the choice stable: a turn towards the best
    heading makes that heading cheaper and all on the other side dearer, so the robot never swings to and fro.
    """
    yaws = robot.yaw_rad + HEADINGS * config.turn_rad
    along_m = np.arange(1, 6) / 5.0 * config.step_m
    x = robot.x_m + np.cos(yaws)[:, None] * along_m
    y = robot.y_m + np.sin(yaws)[:, None] * along_m
    cells = terrain.grid.cells_of(np.stack([x, y], axis=-1))
    inside = terrain.grid.contains(cells)
    cells = np.clip(cells, 0, (terrain.grid.rows - 1, terrain.grid.cols - 1))
    free = (inside & (terrain.speed[cells[..., 0], cells[..., 1]] > 0.0)).all(axis=1)
    free &= ~_bumped(terrain.bumps, robot, yaws)
    left_m = _interpolated(terrain, field, x[:, -1], y[:, -1])
    cost = np.where(free, left_m, UNREACHED) + config.turn_cost_m * np.abs(HEADINGS)
    if not np.isfinite(cost).any():  # boxed in by its own radius: take the way that is least blocked
        clear = (terrain.speed[cells[..., 0], cells[..., 1]] > 0.0).sum(axis=1)
        cost = -clear + config.turn_cost_m * np.abs(HEADINGS)
    best = int(HEADINGS[int(np.argmin(cost))])
    return "move_forward" if best == 0 else "turn_left" if best > 0 else "turn_right"


def _bumped(bumps: NDArray[np.float64], robot: RobotView, yaws: NDArray) -> NDArray[np.bool_]:
    """Which of the headings ``yaws`` (n,) met something when the robot last tried them from about here."""
    near = np.hypot(bumps[:, 0] - robot.x_m, bumps[:, 1] - robot.y_m) < _SAME_SPOT_M
    same: NDArray[np.bool_] = np.cos(yaws[:, None] - bumps[near, 2]) > _SAME_HEADING_COS
    return np.asarray(same.any(axis=1))


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


def _interpolated(
    terrain: Terrain, field: NDArray[np.float64], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The field at places (n,), bilinear over its finite neighbours; inf where the place's own cell is."""
    grid = terrain.grid
    v = np.clip((y_m - grid.origin_y_m) / grid.resolution_m - 0.5, 0.0, grid.rows - 1.0)
    u = np.clip((x_m - grid.origin_x_m) / grid.resolution_m - 0.5, 0.0, grid.cols - 1.0)
    row, col = np.minimum(v.astype(np.int64), grid.rows - 2), np.minimum(u.astype(np.int64), grid.cols - 2)
    fv, fu = v - row, u - col
    rows, cols = np.stack([row, row, row + 1, row + 1]), np.stack([col, col + 1, col, col + 1])
    weight = np.stack([(1 - fv) * (1 - fu), (1 - fv) * fu, fv * (1 - fu), fv * fu])
    value = field[rows, cols]
    weight[~np.isfinite(value)] = 0.0
    total = weight.sum(axis=0)
    own = np.clip(grid.cells_of(np.stack([x_m, y_m], axis=-1)), 0, (grid.rows - 1, grid.cols - 1))
    known = np.isfinite(field[own[:, 0], own[:, 1]]) & (total > 0.0)
    weighted = (weight * np.where(np.isfinite(value), value, 0.0)).sum(axis=0)
    return np.where(known, weighted / np.where(known, total, 1.0), UNREACHED)
