"""The local planner: from a travel-time field to a discrete action and a path to show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.planner.core.settings import PlannerConfig
from services.planner.core.state import RobotView
from services.planner.core.terrain import UNREACHED, Terrain, arrival_m

#: Headings that the robot can turn to, in turns: left positive, a full circle.
_HEADINGS = np.arange(-5, 7)


@dataclass(frozen=True, slots=True)
class Route:
    """A way to a goal: the next action, (x, y) points [m] from the robot to the goal, and the travel time [m]."""

    action: str
    path: tuple[tuple[float, float], ...]
    remaining_m: float


class LocalPlanner(Protocol):
    """Drives to the nearest of some goal cells. ``FmmPlanner`` knows only the map; an oracle can stand in for it."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig, expected_m: float
    ) -> Route | None:
        """The next action towards ``goals`` (bool of the terrain's shape), or None if no way leads there.

        ``expected_m``: about how long the way is (travel time); inf if unknown.
        """


class FmmPlanner:
    """The paper's planner: Fast Marching from the goal over the known map."""

    def route(
        self, terrain: Terrain, goals: NDArray[np.bool_], robot: RobotView, config: PlannerConfig,
        expected_m: float = math.inf,
    ) -> Route | None:  # fmt: skip
        """See ``LocalPlanner``. The field falls all the way to the goal: nothing to get caught in.

        The front runs only a little farther than to the robot.
        """
        row, col = terrain.cell(robot.x_m, robot.y_m)
        field = arrival_m(terrain.speed, goals, terrain.grid.resolution_m, self._enough(expected_m))
        if not math.isfinite(field[row, col]):
            field = arrival_m(terrain.speed, goals, terrain.grid.resolution_m)
        if not math.isfinite(field[row, col]):
            return None
        action = next_action(terrain, field, robot, config)
        return Route(action, descend(terrain, field, row, col), float(field[row, col]))

    @staticmethod
    def _enough(expected_m: float) -> float:
        return 1.15 * expected_m + 1.0 if math.isfinite(expected_m) else 0.0


#: A bump is remembered for this spot and this heading only.
_SAME_SPOT_M = 0.03
_SAME_HEADING_COS = math.cos(math.radians(10.0))


def next_action(terrain: Terrain, field: NDArray[np.float64], robot: RobotView, config: PlannerConfig) -> str:
    """Turns to, or drives along, the heading whose next step ends nearest to the goal.

    Of the twelve headings that the robot can turn to, those with a free step ahead compete by travel time left at
    the step's end plus a small price per turn. The price makes the choice stable: a turn towards the best
    heading makes that heading cheaper and all on the other side dearer, so the robot never swings to and fro.
    """
    yaws = robot.yaw_rad + _HEADINGS * config.turn_rad
    along_m = np.arange(1, 6) / 5.0 * config.step_m
    x = robot.x_m + np.cos(yaws)[:, None] * along_m
    y = robot.y_m + np.sin(yaws)[:, None] * along_m
    cells = terrain.grid.cells_of(np.stack([x, y], axis=-1))
    inside = terrain.grid.contains(cells)
    cells = np.clip(cells, 0, (terrain.grid.rows - 1, terrain.grid.cols - 1))
    free = (inside & (terrain.speed[cells[..., 0], cells[..., 1]] > 0.0)).all(axis=1)
    free &= ~_bumped(terrain.bumps, robot, yaws)
    left_m = np.array([_interpolate(terrain, field, px, py) for px, py in zip(x[:, -1], y[:, -1], strict=True)])
    cost = np.where(free, left_m, UNREACHED) + config.turn_cost_m * np.abs(_HEADINGS)
    if not np.isfinite(cost).any():  # boxed in by its own radius: take the way that is least blocked
        clear = (terrain.speed[cells[..., 0], cells[..., 1]] > 0.0).sum(axis=1)
        cost = -clear + config.turn_cost_m * np.abs(_HEADINGS)
    best = int(_HEADINGS[int(np.argmin(cost))])
    return "move_forward" if best == 0 else "turn_left" if best > 0 else "turn_right"


def _bumped(bumps: NDArray[np.float64], robot: RobotView, yaws: NDArray) -> NDArray[np.bool_]:
    """Which of the headings ``yaws`` (n,) met something when the robot last tried them from about here."""
    near = np.hypot(bumps[:, 0] - robot.x_m, bumps[:, 1] - robot.y_m) < _SAME_SPOT_M
    same: NDArray[np.bool_] = np.cos(yaws[:, None] - bumps[near, 2]) > _SAME_HEADING_COS
    return np.asarray(same.any(axis=1))


def descend(terrain: Terrain, field: NDArray[np.float64], row: int, col: int) -> tuple[tuple[float, float], ...]:
    """(x, y) [m] from a cell down the field to its source, a point every other cell or so.

    Steps to the lowest of the eight neighbours; a diagonal one counts only if both cells beside it are open, so
    the path never cuts a corner.
    """
    padded = np.pad(field, 1, constant_values=UNREACHED)
    cells = [(row, col)]
    for _ in range(field.size):
        around = padded[row : row + 3, col : col + 3].copy()
        if not around[1, 1] > 0.0:
            break
        sides = np.isfinite(around)
        for dr, dc in ((0, 0), (0, 2), (2, 0), (2, 2)):
            if not (sides[dr, 1] and sides[1, dc]):
                around[dr, dc] = UNREACHED
        lowest = int(np.argmin(around))
        if around.flat[lowest] >= around[1, 1]:
            break
        row, col = row + lowest // 3 - 1, col + lowest % 3 - 1
        cells.append((row, col))
    kept = cells[:-1:2] + cells[-1:]
    return tuple((float(x), float(y)) for x, y in terrain.grid.centres_of(np.array(kept)))


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


def _interpolate(terrain: Terrain, field: NDArray[np.float64], x_m: float, y_m: float) -> float:
    """The field at a place, bilinear over its finite neighbours; inf where the place's own cell is."""
    row, col = terrain.cell(x_m, y_m)
    if not math.isfinite(field[row, col]):
        return UNREACHED
    r = terrain.grid.resolution_m
    v = min(max((y_m - terrain.grid.origin_y_m) / r - 0.5, 0.0), field.shape[0] - 1.0)
    u = min(max((x_m - terrain.grid.origin_x_m) / r - 0.5, 0.0), field.shape[1] - 1.0)
    row, col = min(int(v), field.shape[0] - 2), min(int(u), field.shape[1] - 2)
    fv, fu = v - row, u - col
    total = weight = 0.0
    for dr, dc, w in ((0, 0, (1 - fv) * (1 - fu)), (0, 1, (1 - fv) * fu), (1, 0, fv * (1 - fu)), (1, 1, fv * fu)):
        value = field[row + dr, col + dc]
        if math.isfinite(value):
            total, weight = total + w * value, weight + w
    return total / weight if weight > 0 else UNREACHED
