"""Stairs as goals: where they lead, how far it is, and from where each can be taken."""

from __future__ import annotations

import heapq
import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import Stair
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import is_still_wanted, memory_of, never_leaves
from surveilnav.services.planner.core.motion.terrain import lines_are_clear

#: The end of stairs counts as seen if a cell this near to it is explored.
_SEEN_M = 0.3


class PathToFloor(NamedTuple):
    """The cheapest path to a floor: travel time and length of stairs together [m], and the first stairs on it."""

    cost_m: float
    first_stairs: Stair


def path_to_floor_goal(context: StepContext) -> PathToFloor | None:
    """The path to the floor that the robot is heading for. None: it isn't heading for one that there is still a reason to go
    to, or no way leads there."""
    goal = context.state.floor_goal
    if goal is None or never_leaves(context) or not is_still_wanted(context, goal):
        return None
    return paths_to_floors(context).get(goal.to_floor)


def paths_to_floors(context: StepContext, *, also_unseen: bool = False) -> dict[str, PathToFloor]:
    """The cheapest path to every floor that can be reached, by Dijkstra's algorithm over the stairs of the building.

    ``also_unseen``: by stairs, too, that nobody has seen yet.
    """
    all_stairs = context.robot.stairs
    order = itertools.count()  # decides between equal costs, always in the same way
    queue: list[tuple[float, int, Stair, Stair]] = []  # (cost after the last stairs, order, first stairs, last stairs)
    for stairs in all_stairs:
        if stairs.floor == context.state.floor and _may_be_headed_for(context, stairs, also_unseen):
            time_m = float(context.travel_time_m[goal_cells(context, stairs)].min(initial=math.inf))
            if math.isfinite(time_m):
                heapq.heappush(queue, (time_m + stairs.length_m, next(order), stairs, stairs))
    best: dict[str, PathToFloor] = {}
    done: set[int] = set()
    while queue:
        cost_m, _, first, last = heapq.heappop(queue)
        if id(last) in done:
            continue
        done.add(id(last))
        best.setdefault(last.to_floor, PathToFloor(cost_m, first))
        for stairs in all_stairs:
            if stairs.floor != last.to_floor or stairs.to_floor == context.state.floor or id(stairs) in done:
                continue
            if not _failed_too_often(context, stairs):
                walk_m = math.dist(last.to_m[:2], stairs.at_m[:2])
                heapq.heappush(queue, (cost_m + walk_m + stairs.length_m, next(order), first, stairs))
    return best


def goal_radius_m(context: StepContext, stairs: Stair) -> float:
    """How near to the end of stairs the robot goes to take them: nearer after every failure."""
    failures = context.state.here.stairs_failures_at(*stairs.at_m[:2])
    return max(context.config.stairs_radius_m * 0.5**failures, context.terrain.grid.resolution_m)


def goal_cells(context: StepContext, stairs: Stair) -> NDArray[np.bool_]:
    """Cells of the terrain from which stairs can be taken: reachable, near their end, and with no obstacle in between."""
    x_m, y_m = stairs.at_m[:2]
    near = context.terrain.disc(x_m, y_m, goal_radius_m(context, stairs)) & np.isfinite(context.travel_time_m)
    cells = np.argwhere(near)
    end = np.full(cells.shape, context.terrain.cell(x_m, y_m))
    near[cells[:, 0], cells[:, 1]] = lines_are_clear(context.terrain.occupied, cells, end, 0.0)
    return near


def _may_be_headed_for(context: StepContext, stairs: Stair, also_unseen: bool) -> bool:
    """Whether stairs of this floor may be headed for: they didn't fail too often, and are seen or may be used unseen."""
    if _failed_too_often(context, stairs):
        return False
    if also_unseen or context.config.stairs_known == "plan" or context.state.here.is_searched:
        return True
    explored = context.terrain.crop(context.maps.explored) != 0
    return bool((context.terrain.disc(*stairs.at_m[:2], _SEEN_M) & explored).any())


def _failed_too_often(context: StepContext, stairs: Stair) -> bool:
    failures = memory_of(context, stairs.floor).stairs_failures_at(*stairs.at_m[:2])
    return failures >= context.config.max_stairs_failures
