"""Stairs as goals: which lead where, how far it is, and from where each can be taken."""

from __future__ import annotations

import heapq
import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import Stair
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import memory_of
from surveilnav.services.planner.core.motion.terrain import clear_lines

#: A stair's end counts as seen if a cell so near to it is explored.
_SEEN_M = 0.3


class WayToFloor(NamedTuple):
    """The cheapest way to a floor: travel time and stairs together [m], and its first stair."""

    cost_m: float
    stair: Stair


def ways(context: StepContext) -> dict[str, WayToFloor]:
    """By floor that can be got to: the cost [m] of the cheapest way (Dijkstra over stairs) and its first stair."""
    stairs, tries = context.robot.stairs, context.config.stairs_tries
    order = itertools.count()  # decides between equals, always the same
    queue: list[tuple[float, int, Stair, Stair]] = []
    for stair in stairs:
        if stair.floor == context.state.floor and _usable(context, stair):
            way_m = float(context.travel_time_m[foot(context, stair)].min(initial=math.inf))
            if math.isfinite(way_m):
                heapq.heappush(queue, (way_m + stair.length_m, next(order), stair, stair))
    best: dict[str, WayToFloor] = {}
    done: set[int] = set()
    while queue:
        cost_m, _, first, last = heapq.heappop(queue)
        if id(last) in done:
            continue
        done.add(id(last))
        best.setdefault(last.to_floor, WayToFloor(cost_m, first))
        for stair in stairs:
            if stair.floor != last.to_floor or stair.to_floor == context.state.floor or id(stair) in done:
                continue
            if memory_of(context, stair.floor).stairs_failed.get(memory.stair_name(*stair.at_m[:2]), 0) < tries:
                walk_m = math.dist(last.to_m[:2], stair.at_m[:2])
                heapq.heappush(queue, (cost_m + walk_m + stair.length_m, next(order), first, stair))
    return best


def _usable(context: StepContext, stair: Stair) -> bool:
    """Whether a stair of this floor may be headed for: not barred, and seen or known anyway."""
    x_m, y_m = stair.at_m[:2]
    if context.state.here.stairs_failed.get(memory.stair_name(x_m, y_m), 0) >= context.config.stairs_tries:
        return False
    if context.config.stairs_known == "plan" or context.state.here.exhausted:
        return True
    return bool((context.terrain.disc(x_m, y_m, _SEEN_M) & (context.terrain.crop(context.maps.explored) != 0)).any())


def reach_m(context: StepContext, stair: Stair) -> float:
    """How near to a stair's end the robot goes: nearer after every try that failed."""
    failed = context.state.here.stairs_failed.get(memory.stair_name(*stair.at_m[:2]), 0)
    return max(context.config.stairs_reach_m * 0.5**failed, context.terrain.grid.resolution_m)


def foot(context: StepContext, stair: Stair) -> NDArray[np.bool_]:
    """Cells of the terrain from which a stair can be taken: near its end, nothing mapped in between, a way leads there."""
    x_m, y_m = stair.at_m[:2]
    near = context.terrain.disc(x_m, y_m, reach_m(context, stair)) & np.isfinite(context.travel_time_m)
    cells = np.argwhere(near)
    end = np.full(cells.shape, context.terrain.cell(x_m, y_m))
    near[cells[:, 0], cells[:, 1]] = clear_lines(context.terrain.occupied, cells, end, 0.0)
    return near
