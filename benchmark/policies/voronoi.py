"""VoroNav's rule (Wu et al., ICML 2024, https://arxiv.org/abs/2401.02695): decisions where ways part.

Kept: the robot drives along the generalised Voronoi graph of the free space, from node to node, and decides at nodes only. Of
the neighbouring nodes it takes the best by exploration first, then efficiency, then meaning: one that leads to something
unexplored, where it hasn't been, and of these the one where the target is likeliest by what lies along the ways from there to
what is unexplored. The first detection of the target is believed.
Not kept: GPT-3.5 (how often classes share a room in the train homes, ``cooccurrence.json``, stands in), BLIP's captions of what
is to be seen from a node (what is mapped within 2 m of the ways stands in), and the full turn at every node.
We found no program of the authors (https://voro-nav.github.io). How exploration and efficiency are measured is our reading, and
so is this: a frontier belongs to the node nearest to it; from its own node, and where all neighbours were visited, the robot goes
to the nearest frontier itself; and it decides anew once nothing unexplored is left where it is heading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.policies.cooccurrence import Cooccurrence, of_train
from surveilnav.benchmark.policies.mission import MissionPolicy, first_sight
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.benchmark.policies.voronoi_graph import Cell, VoronoiGraph, voronoi_graph
from surveilnav.messages import ObjectRecord
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.options.frontiers import only

CONFIG = PlannerConfig(verification="paper", choice="paper")

#: Cells of the graph [m].
_CELL_M = 0.1
_REACHED_M, _WITHIN_M = 0.6, 2.0
#: A frontier's cell may be none of the free ones.
_BESIDE_CELLS = 5


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A node that the robot may go to next.

    ``leads_to``: the indices of the frontiers that the shortest ways over it lead to. ``cells``: of these ways.
    """

    node: int
    leads_to: tuple[int, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class Goal:
    """Where the robot is heading: a node, or a frontier. ``beyond``: (x, y) [m] of the frontiers that it leads to."""

    place: Frontier
    floor: str
    is_node: bool
    beyond: tuple[tuple[float, float], ...]


class VoronoiRule:
    """Goes from node to node; remembers where it is heading, and where it was."""

    def __init__(self, known: Cooccurrence) -> None:
        self._known = known
        self._goal: Goal | None = None
        self._visited: list[tuple[str, float, float]] = []

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        """See ``FrontierRule``: nodes stand in for frontiers."""
        if not found:
            return []
        goal = self._goal = self._kept(context, found) or self._next(context, found)
        why = "the next node of the Voronoi graph" if goal.is_node else "the nearest frontier"
        return only(context, goal.place, [goal.place], why)

    def _kept(self, context: StepContext, found: Sequence[Frontier]) -> Goal | None:
        """Where the robot is heading; None: it is there, no way leads there, or nothing unexplored is left there."""
        goal, robot, same_m = self._goal, context.robot, 1.5 * context.config.same_place_m
        if goal is None or goal.floor != robot.floor:
            return None
        at = goal.place.x_m, goal.place.y_m
        if goal.is_node and math.dist(at, (robot.x_m, robot.y_m)) <= _REACHED_M:
            self._visited.append((robot.floor, *at))
            return None
        left = [f for f in found if any(math.dist((f.x_m, f.y_m), p) <= same_m for p in goal.beyond)]
        if not left or context.is_blacklisted(*at):
            return None
        if goal.is_node:
            place = _place(context, at)
            return replace(goal, place=place) if place else None
        return _to_frontier(
            context, min(left, key=lambda f: math.dist((f.x_m, f.y_m), at))
        )  # it may have moved a little

    def _next(self, context: StepContext, found: Sequence[Frontier]) -> Goal:
        """Where to go next from the node that the robot is at."""
        nearest = min(found, key=lambda f: f.travel_time_m)
        graph, factor = graph_of(context)
        terrain, robot = context.terrain, context.robot
        start = _node_at(graph, terrain.cell(robot.x_m, robot.y_m), factor)
        at_nodes = [_node_at(graph, terrain.cell(f.x_m, f.y_m), factor) for f in found]
        here = [f for f, node in zip(found, at_nodes, strict=True) if node in (start, -1)]
        if start < 0 or here:
            return _to_frontier(context, min(here or [nearest], key=lambda f: f.travel_time_m))
        best, best_reward = None, (-1.0, 0.0)
        for neighbour in neighbours(graph, start, at_nodes):
            place = _place(context, terrain.centre_of(*_terrain_cell(graph.nodes[neighbour.node], factor)))
            if place is None or self._is_left_alone(context, place):
                continue
            cells = np.array([_terrain_cell(cell, factor) for cell in neighbour.cells])
            near = labels_near(np.asarray(terrain.grid.centres_of(cells)), context.maps.objects)
            reward = self._known.chance(context.state.target, near), -place.travel_time_m
            if reward > best_reward:
                beyond = tuple((found[i].x_m, found[i].y_m) for i in neighbour.leads_to)
                best, best_reward = Goal(place, robot.floor, is_node=True, beyond=beyond), reward
        return best or _to_frontier(context, nearest)

    def _is_left_alone(self, context: StepContext, place: Frontier) -> bool:
        """Whether the robot is or was at a node, or failed to reach it."""
        at, robot = (place.x_m, place.y_m), context.robot
        been = [(robot.x_m, robot.y_m), *((x_m, y_m) for floor, x_m, y_m in self._visited if floor == robot.floor)]
        return context.is_blacklisted(*at) or any(math.dist(at, p) <= _REACHED_M for p in been)


def neighbours(graph: VoronoiGraph, start: int, at_nodes: Sequence[int]) -> list[Neighbour]:
    """The first nodes on the ways from ``start`` to nodes that frontiers belong to; ``at_nodes``: by frontier, its node."""
    routes = graph.routes(start)
    leads_to: dict[int, list[int]] = {}
    for i, node in enumerate(at_nodes):
        route = routes.get(node, [])
        if len(route) > 1:
            leads_to.setdefault(route[1], []).append(i)
    return [
        Neighbour(
            first,
            tuple(frontiers),
            tuple(cell for i in sorted({at_nodes[i] for i in frontiers}) for cell in graph.cells_along(routes[i])),
        )
        for first, frontiers in sorted(leads_to.items())
    ]


def labels_near(way_m: NDArray[np.float64], objects: Sequence[ObjectRecord]) -> set[str]:
    """The classes of objects within 2 m of a way (n, 2) [m]."""
    return {
        o.label
        for o in objects
        if o.status != "rejected" and float(np.linalg.norm(way_m - o.center_m[:2], axis=1).min()) <= _WITHIN_M
    }


def graph_of(context: StepContext) -> tuple[VoronoiGraph, int]:
    """The graph of known space where the robot can be, and how many cells of the terrain make one of it."""
    terrain, config = context.terrain, context.config
    factor = max(1, round(_CELL_M / terrain.grid.resolution_m))
    free = terrain.known & (terrain.speed > config.constrained_speed) & np.isfinite(context.travel_time_m)
    rows, cols = (n // factor * factor for n in free.shape)
    coarse = free[:rows, :cols].reshape(rows // factor, factor, cols // factor, factor).all(axis=(1, 3))
    return voronoi_graph(np.asarray(coarse)), factor


def _terrain_cell(cell: Cell, factor: int) -> Cell:
    """The cell of the terrain in the middle of a cell of the graph."""
    return cell[0] * factor + factor // 2, cell[1] * factor + factor // 2


def _node_at(graph: VoronoiGraph, terrain_cell: Cell, factor: int) -> int:
    """The node that a cell of the terrain belongs to, or the free one nearest to it within half a metre; -1: none."""
    (rows, cols), k = graph.nearest.shape, _BESIDE_CELLS
    row, col = min(terrain_cell[0] // factor, rows - 1), min(terrain_cell[1] // factor, cols - 1)
    if graph.nearest[row, col] >= 0:
        return int(graph.nearest[row, col])
    around = graph.nearest[max(0, row - k) : row + k + 1, max(0, col - k) : col + k + 1]
    there = np.argwhere(around >= 0)
    if not len(there):
        return -1
    middle = row - max(0, row - k), col - max(0, col - k)
    r, c = there[np.argmin(((there - middle) ** 2).sum(axis=1))]
    return int(around[r, c])


def _to_frontier(context: StepContext, frontier: Frontier) -> Goal:
    return Goal(frontier, context.robot.floor, is_node=False, beyond=((frontier.x_m, frontier.y_m),))


def _place(context: StepContext, p_m: tuple[float, float]) -> Frontier | None:
    """A place as a rule's answer; None: no way leads there."""
    time_m = float(context.travel_time_m[context.terrain.cell(*p_m)])
    return Frontier(*p_m, 1, time_m) if math.isfinite(time_m) else None


VORONOI = Policy(
    "voronoi",
    "from node to node of the Voronoi graph, VoroNav (https://arxiv.org/abs/2401.02695)",
    lambda task: MissionPolicy(task, CONFIG, VoronoiRule(of_train())),
    first_sight(FusionConfig()),
)
#: Its rule alone, as for VLFM.
VORONOI_VERIFIED = Policy(
    "voronoi-verified",
    "VoroNav's nodes of the Voronoi graph (https://arxiv.org/abs/2401.02695) with our verification",
    lambda task: MissionPolicy(task, PlannerConfig(), VoronoiRule(of_train())),
    FusionConfig(),
)
