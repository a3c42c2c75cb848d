"""The Voronoi graph of free space, and which of its nodes the rule goes to."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.benchmark.policies import voronoi
from surveilnav.benchmark.policies.cooccurrence import Cooccurrence
from surveilnav.benchmark.policies.voronoi import VoronoiRule
from surveilnav.benchmark.policies.voronoi_graph import thinned, voronoi_graph
from surveilnav.geometry import Grid
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.goals.frontiers import Frontier


def components(cells):
    return cv2.connectedComponents(np.asarray(cells).astype(np.uint8), connectivity=8)[0] - 1


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30), st.integers(3, 20), st.integers(3, 20)), max_size=6))
def test_thin_lines_lie_in_free_space_and_are_connected_as_it_is(rooms):
    free = np.zeros((40, 40), bool)
    for row, col, rows, cols in rooms:
        free[row : row + rows, col : col + cols] = True
    lines = thinned(free)
    assert not (lines & ~free).any()
    assert components(lines) == components(free)
    blocks = lines[:-1, :-1] & lines[1:, :-1] & lines[:-1, 1:] & lines[1:, 1:]
    assert blocks.sum() <= 2 * len(rooms)  # hardly ever thicker than one cell


#: Three corridors that meet in (20, 20), and a room of its own.
CROSS = np.zeros((41, 41), bool)
CROSS[18:23, 2:39] = True
CROSS[20:39, 18:23] = True
APART = CROSS.copy()
APART[2:9, 2:9] = True


def test_a_node_is_where_ways_part_or_one_ends():
    graph = voronoi_graph(CROSS)
    assert len(graph.nodes) == 4
    middle = min(range(4), key=lambda i: math.dist(graph.nodes[i], (20, 20)))
    assert math.dist(graph.nodes[middle], (20, 20)) <= 2.0
    ends = [graph.nodes[i] for i in range(4) if i != middle]
    for end in ((20, 4), (20, 36), (36, 20)):
        assert min(math.dist(node, end) for node in ends) <= 2.0
    assert set(graph.ways) == {pair for i in range(4) if i != middle for pair in ((i, middle), (middle, i))}
    for (a, b), cells in graph.ways.items():
        assert (cells[0], cells[-1]) == (graph.nodes[a], graph.nodes[b])
        assert all(max(abs(p[0] - q[0]), abs(p[1] - q[1])) <= 2 for p, q in itertools.pairwise(cells))


def test_routes_lead_over_neighbours_and_not_to_what_is_apart():
    graph = voronoi_graph(APART)
    left = min(range(len(graph.nodes)), key=lambda i: math.dist(graph.nodes[i], (20, 4)))
    middle = min(range(len(graph.nodes)), key=lambda i: math.dist(graph.nodes[i], (20, 20)))
    right = min(range(len(graph.nodes)), key=lambda i: math.dist(graph.nodes[i], (20, 36)))
    routes = graph.routes(left)
    assert routes[left] == [left]
    assert routes[right] == [left, middle, right]
    assert all(graph.nodes[i][0] > 9 for i in routes)
    assert graph.cells_along(routes[left]) == [graph.nodes[left]]
    assert len(graph.cells_along(routes[right])) == pytest.approx(33, abs=6)


def test_the_shorter_of_two_ways_around_is_the_route():
    ring = np.zeros((41, 61), bool)
    ring[3:38, 3:58] = True
    ring[8:33, 8:33] = False
    ring[12:29, 38:53] = False
    graph = voronoi_graph(ring)
    for start in range(len(graph.nodes)):
        for node, route in graph.routes(start).items():
            lengths = {other: len(r) for other, r in graph.routes(node).items()}
            assert len(route) >= 1
            assert start in lengths
    a = min(range(len(graph.nodes)), key=lambda i: math.dist(graph.nodes[i], (5, 35)))
    b = min(range(len(graph.nodes)), key=lambda i: math.dist(graph.nodes[i], (35, 35)))
    assert len(graph.cells_along(graph.routes(a)[b])) <= 40  # through the middle, not around


def test_every_free_cell_has_the_node_that_is_nearest_along_free_cells():
    wall = np.ones((21, 41), bool)
    wall[:18, 20] = False
    graph = voronoi_graph(wall)
    assert (graph.nearest >= 0).tolist() == wall.tolist()
    assert graph.nodes[graph.nearest[2, 19]][1] < 20 < graph.nodes[graph.nearest[2, 21]][1]
    assert voronoi_graph(np.zeros((5, 5), bool)).nearest.tolist() == np.full((5, 5), -1).tolist()


# --- the rule -----------------------------------------------------------------------------------------------------

CELL_M = 0.2
KNOWN = Cooccurrence.of_rooms([["bed"]] * 8 + [["toilet", "sink"]] * 8)


def context_of(at, things=(), target="toilet", floor="0", barred=()):
    """The corridors of ``CROSS``; the robot at a cell (row, col)."""
    grid = Grid(0.0, 0.0, CELL_M, *CROSS.shape)

    def cell(x_m, y_m):
        row, col = grid.cells_of((x_m, y_m))
        return int(row), int(col)

    def centre_of(row, col):
        x_m, y_m = grid.centres_of((row, col))
        return float(x_m), float(y_m)

    terrain = SimpleNamespace(grid=grid, known=CROSS, speed=CROSS.astype(float), cell=cell, centre_of=centre_of)
    rows, cols = np.mgrid[: CROSS.shape[0], : CROSS.shape[1]]
    away_m = CELL_M * np.hypot(rows - at[0], cols - at[1])
    x_m, y_m = centre_of(*at)
    return SimpleNamespace(
        config=PlannerConfig(),
        terrain=terrain,
        travel_time_m=np.where(CROSS, away_m, np.inf),
        maps=SimpleNamespace(objects=list(things)),
        robot=SimpleNamespace(x_m=x_m, y_m=y_m, floor=floor),
        state=SimpleNamespace(target=target),
        is_blacklisted=lambda x_m, y_m: any(math.dist((x_m, y_m), centre_of(*c)) < 0.5 for c in barred),
    )


def at(row, col):
    return Frontier((col + 0.5) * CELL_M, (row + 0.5) * CELL_M, 9, CELL_M * math.dist((row, col), (20, 20)))


def thing(label, row, col, status="candidate"):
    return SimpleNamespace(label=label, status=status, center_m=((col + 0.5) * CELL_M, (row + 0.5) * CELL_M, 0.4))


def goal_of(rule, context, found):
    """The cell (row, col) of where it goes."""
    (chosen,) = [r.frontier for r in rule(context, found) if r.utility > 0.0]
    return int(chosen.y_m / CELL_M), int(chosen.x_m / CELL_M)


LEFT, RIGHT, DOWN = at(20, 2), at(20, 38), at(38, 20)


def near(cell, other):
    return math.dist(cell, other) <= 3.0


def test_it_goes_to_the_node_whose_ways_suggest_the_target():
    for things, end in (
        ([thing("sink", 22, 34)], (20, 36)),
        ([thing("sink", 36, 22)], (36, 20)),
        ([thing("bed", 22, 34), thing("bed", 34, 20)], (20, 4)),  # what speaks against the others
        ([thing("sink", 22, 34, "rejected"), thing("sink", 34, 20)], (36, 20)),
    ):
        rule = VoronoiRule(KNOWN)
        assert near(goal_of(rule, context_of((20, 20), things), [LEFT, RIGHT, DOWN]), end), end


def test_it_goes_only_where_something_is_unexplored_and_decides_at_nodes():
    rule = VoronoiRule(KNOWN)
    sink = thing("sink", 36, 22)
    assert near(goal_of(rule, context_of((20, 20)), [RIGHT]), (20, 36))
    assert near(goal_of(rule, context_of((20, 24), [sink]), [RIGHT, DOWN]), (20, 36))  # between nodes it keeps to it
    assert near(goal_of(rule, context_of((20, 24), [sink]), [DOWN]), (36, 20))  # nothing is left there
    assert goal_of(rule, context_of((36, 20), [sink]), [DOWN]) == (38, 20)  # at its node, to the frontier itself
    assert near(goal_of(rule, context_of((36, 20), [sink]), [LEFT]), (20, 20))  # back over where ways part
    assert rule(context_of((36, 20)), []) == []


def test_it_follows_a_frontier_that_moves():
    rule = VoronoiRule(KNOWN)
    assert goal_of(rule, context_of((20, 36)), [RIGHT, LEFT]) == (20, 38)
    assert goal_of(rule, context_of((20, 36)), [LEFT, at(22, 37)]) == (22, 37)
    assert goal_of(rule, context_of((20, 36)), [LEFT, at(20, 35)]) == (20, 35)
    assert near(goal_of(rule, context_of((20, 36)), [LEFT]), (20, 20))


def test_it_prefers_nodes_where_it_has_not_been():
    rule = VoronoiRule(KNOWN)
    assert near(goal_of(rule, context_of((20, 20)), [RIGHT]), (20, 36))
    assert near(goal_of(rule, context_of((20, 36)), [LEFT]), (20, 20))
    sink = [thing("sink", 22, 34)]
    assert near(goal_of(rule, context_of((20, 20), sink), [LEFT, RIGHT]), (20, 4))
    assert near(goal_of(VoronoiRule(KNOWN), context_of((20, 20), sink), [LEFT, RIGHT]), (20, 36))


def test_where_it_has_been_everywhere_it_goes_to_the_nearest_frontier():
    """It would go to and fro between two nodes that both suggest the target."""
    rule, sinks = VoronoiRule(KNOWN), [thing("sink", 22, 34)]
    for cell, found in (
        ((20, 20), [RIGHT]),
        ((20, 36), [LEFT]),
        ((20, 20), [LEFT]),
        ((20, 4), [DOWN]),
        ((20, 20), [DOWN]),
    ):
        goal_of(rule, context_of(cell), found)
    assert near(goal_of(rule, context_of((36, 20)), [LEFT]), (20, 2))
    near_left = at(20, 10)
    assert goal_of(rule, context_of((20, 20), sinks), [RIGHT, near_left]) == (20, 10)


def test_it_leaves_alone_what_is_blacklisted_and_forgets_other_floors():
    rule = VoronoiRule(KNOWN)
    assert near(goal_of(rule, context_of((20, 20), [thing("sink", 22, 34)]), [LEFT, RIGHT]), (20, 36))
    barred = [(20, 36), (20, 35), (20, 37)]
    assert near(goal_of(rule, context_of((20, 20), [thing("sink", 22, 34)], barred=barred), [LEFT, RIGHT]), (20, 4))
    assert near(goal_of(rule, context_of((20, 20), floor="1"), [RIGHT]), (20, 36))


def test_without_a_graph_it_goes_to_the_nearest_frontier(monkeypatch):
    monkeypatch.setattr(voronoi, "voronoi_graph", lambda free: voronoi_graph(np.zeros_like(free)))
    assert goal_of(VoronoiRule(KNOWN), context_of((20, 20)), [at(20, 30), RIGHT]) == (20, 30)
