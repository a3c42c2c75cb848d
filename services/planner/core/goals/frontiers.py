"""Frontiers: from frontier cells to places that the robot can head for, and their ranking."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.occupancy import PRIOR_FREE
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.inputs import FloorMaps
from surveilnav.services.planner.core.motion.terrain import Terrain

#: Where the value alone ranks frontiers, a metre of travel costs this little, so that it only decides between equal values.
_TIE_BREAK_PER_M = 1e-6
#: Floor within this of a frontier may be hidden behind it, and so much is as good as a wide frontier.
_HIDDEN_WITHIN_M, _MUCH_HIDDEN_M2 = 2.0, 6.0
#: Values whose standard deviation is less are equal.
_MIN_STD = 1e-6


@dataclass(frozen=True, slots=True)
class Frontier:
    """A piece of frontier.

    Attributes:
        x_m, y_m: its middle cell [m, world].
        n_cells: its size in cells.
        travel_time_m: from the robot, in metres of comfortable free space.
        value: relevance to the target by the strategy; NaN where nothing is known.
        relative_chance: the chance that the target is found by exploring it, by what it seems to hide and its value; 1: a wide
            frontier of the lowest value.
        score: what ranks it, higher is better: ``relative_chance`` for each metre, or its value alone.
        hidden_m2: known free floor around it that nobody has looked at, by a map from before; NaN: there is no such map.
    """

    x_m: float
    y_m: float
    n_cells: int
    travel_time_m: float
    value: float = math.nan
    score: float = 0.0
    hidden_m2: float = math.nan
    relative_chance: float = 1.0


def find_frontiers(
    maps: FloorMaps, terrain: Terrain, travel_time_m: NDArray[np.float64], config: PlannerConfig
) -> list[Frontier]:
    """Finds clusters of at least ``frontier_min_cells`` cells (8-connected) that a way leads to; long ones are cut into pieces.

    ``travel_time_m``: from the robot (the terrain's shape). A piece whose middle lies in an inflated obstacle is reached
    through the nearest open cell within ``same_place_m``.
    """
    cells = np.ascontiguousarray(terrain.crop(maps.frontier) != 0).astype(np.uint8)
    _, labels = cv2.connectedComponents(cells, connectivity=8)
    marked = np.argwhere(cells)
    label = labels[marked[:, 0], marked[:, 1]]
    by_label = np.argsort(label, kind="stable")
    found, hidden_m2 = [], _hidden_m2(terrain.crop(maps.occupancy), terrain.grid.resolution_m)
    for members in np.split(marked[by_label], np.flatnonzero(np.diff(label[by_label])) + 1):
        if len(members) < config.frontier_min_cells:
            continue
        for piece in _pieces(members, config.frontier_piece_m / terrain.grid.resolution_m):
            middle = piece[np.argmin(((piece - piece.mean(axis=0)) ** 2).sum(axis=1))]
            time_m = _least_travel_time(travel_time_m, middle, config.same_place_m / terrain.grid.resolution_m)
            if math.isfinite(time_m):
                x, y = terrain.centre_of(int(middle[0]), int(middle[1]))
                hidden = math.nan if hidden_m2 is None else float(hidden_m2[middle[0], middle[1]])
                found.append(Frontier(x, y, len(piece), time_m, hidden_m2=hidden))
    return found


def _hidden_m2(occupancy: NDArray[np.uint8], resolution_m: float) -> NDArray[np.float32] | None:
    """Around each cell, the area of free floor that only a map from before knows; None without such a map."""
    hidden = occupancy == PRIOR_FREE
    if not hidden.any():
        return None
    side = 2 * round(_HIDDEN_WITHIN_M / resolution_m) + 1
    share = cv2.boxFilter(hidden.astype(np.float32), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(share * (side * resolution_m) ** 2, np.float32)


def rank(
    frontiers: Sequence[Frontier], maps: FloorMaps, target: str, config: PlannerConfig
) -> tuple[list[Frontier], bool]:
    """The frontiers with their values and scores, best first, and whether values were used.

    Values are used where they differ enough to mean something (``values_differ_enough``).
    """
    valued = [replace(f, value=_value(f, maps, target, config)) for f in frontiers]
    values = np.array([f.value for f in valued])
    exploit = config.strategy != "greedy" and values_differ_enough(values, config)
    if exploit:
        low, high = np.nanmin(values), np.nanmax(values)
        scaled = np.nan_to_num((values - low) / (high - low), nan=0.0)
    else:
        scaled = np.zeros(len(valued))
    wide = config.frontier_wide_m / maps.grid.resolution_m
    likely = [
        replace(f, relative_chance=_hides(f, wide) * (1.0 + config.value_gain * float(s)))
        for f, s in zip(valued, scaled, strict=True)
    ]
    scored = [replace(f, score=_score(f, float(s), config)) for f, s in zip(likely, scaled, strict=True)]
    return sorted(scored, key=lambda f: -f.score), exploit


def _hides(frontier: Frontier, wide: float) -> float:
    """What a frontier is expected to hide, 0.5 to 1: a wide one (``wide`` cells) more than a slit. Where a map from before knows
    how much is hidden, that counts instead."""
    if not math.isnan(frontier.hidden_m2):
        return weight_by_hidden(frontier)
    return 0.5 + 0.5 * min(1.0, frontier.n_cells / wide)


def weight_by_hidden(frontier: Frontier) -> float:
    """0.5 to 1 by how much a map from before knows to be hidden beyond a frontier; 1 without such a map."""
    return 1.0 if math.isnan(frontier.hidden_m2) else 0.5 + 0.5 * min(1.0, frontier.hidden_m2 / _MUCH_HIDDEN_M2)


def _score(frontier: Frontier, scaled_value: float, config: PlannerConfig) -> float:
    """A frontier's score: its relative chance per metre, or its scaled value (0 to 1) alone."""
    if config.frontier_score == "value":
        return (scaled_value + _TIE_BREAK_PER_M) / (1.0 + _TIE_BREAK_PER_M * frontier.travel_time_m)
    return frontier.relative_chance / exploring_cost_m(frontier, config)


def exploring_cost_m(frontier: Frontier, config: PlannerConfig) -> float:
    """What it costs to explore a frontier [m]: the way there, and what is expected beyond it."""
    return frontier.travel_time_m + config.explore_cost_m


def values_differ_enough(values: NDArray[np.float64], config: PlannerConfig) -> bool:
    """Whether values differ enough to rank frontiers by them (ApexNav's rule, arXiv 2504.14478).

    Their standard deviation and the ratio of their maximum to their mean must both be large enough. With ``exploit``
    "always" it suffices that they differ at all.
    """
    known = values[np.isfinite(values)]
    if known.size < 2:
        return False
    mean, top = float(known.mean()), float(known.max())
    always = config.exploit == "always"
    least_std, least_ratio = (_MIN_STD, 1.0) if always else (config.exploit_min_std, config.exploit_min_ratio)
    return float(known.std()) >= least_std and mean > 0.0 and top / mean >= least_ratio


def unexplored_side(maps: FloorMaps, terrain: Terrain, x_m: float, y_m: float) -> tuple[float, float] | None:
    """Where to look from a frontier: the middle (x, y) [m] of the unexplored cells within 0.5 m of it. None: there are none."""
    hidden = (terrain.crop(maps.explored) == 0) & ~terrain.occupied & terrain.disc(x_m, y_m, 0.5)
    cells = np.argwhere(hidden)
    if cells.size == 0:
        return None
    x, y = terrain.grid.centres_of(cells.mean(axis=0))
    return float(x), float(y)


def _pieces(cells: NDArray[np.int64], length: float) -> list[NDArray[np.int64]]:
    """Cuts cells (n, 2) along their principal axis into pieces of equal length, at most ``length`` cells."""
    centred = cells - cells.mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    along = centred @ axis
    n = max(1, math.ceil((along.max() - along.min() + 1.0) / length))
    if n == 1:
        return [cells]
    bins = np.minimum(((along - along.min()) / (np.ptp(along) + 1e-9) * n).astype(int), n - 1)
    return [cells[bins == b] for b in range(n) if (bins == b).any()]


def _least_travel_time(travel_time_m: NDArray[np.float64], cell: NDArray[np.int64], radius: float) -> float:
    """The travel time to a cell or, if it isn't open, the least within ``radius`` cells of it."""
    row, col = int(cell[0]), int(cell[1])
    if math.isfinite(travel_time_m[row, col]):
        return float(travel_time_m[row, col])
    k = int(radius)
    return float(travel_time_m[max(0, row - k) : row + k + 1, max(0, col - k) : col + k + 1].min())


def _value(frontier: Frontier, maps: FloorMaps, target: str, config: PlannerConfig) -> float:
    """A frontier's value by the strategy; NaN where nothing is known."""
    if config.strategy == "region":
        return _map_value(frontier, maps, config)
    if config.strategy == "object":
        return _object_value(frontier, maps, target, config)
    return math.nan


def values_near(maps: FloorMaps, frontier: Frontier, radius_m: float) -> NDArray[np.float32]:
    """The known values (n,) of the map in a square around a frontier's middle, ``radius_m`` to each side."""
    row, col = (int(v) for v in maps.grid.cells_of((frontier.x_m, frontier.y_m)))
    k = max(1, round(radius_m / maps.grid.resolution_m))
    window = maps.value[max(0, row - k) : row + k + 1, max(0, col - k) : col + k + 1]
    return window[np.isfinite(window)]


def _map_value(frontier: Frontier, maps: FloorMaps, config: PlannerConfig) -> float:
    """The highest value of the map within ``value_radius_m``; NaN if none is known."""
    known = values_near(maps, frontier, config.value_radius_m)
    return float(known.max()) if known.size else math.nan


def _object_value(frontier: Frontier, maps: FloorMaps, target: str, config: PlannerConfig) -> float:
    """The relevance of the most relevant object near by, less with its distance; 0 if there is none."""
    best = 0.0
    for record in maps.objects:
        away_m = math.hypot(record.center_m[0] - frontier.x_m, record.center_m[1] - frontier.y_m)
        if away_m < config.object_radius_m:
            best = max(best, record.label_scores.get(target, 0.0) * (1.0 - away_m / config.object_radius_m))
    return best
