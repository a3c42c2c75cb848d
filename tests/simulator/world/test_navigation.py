from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

from surveilnav.errors import BuildingError
from surveilnav.geometry import Grid
from surveilnav.simulator.world.geodesic import first_blocked, occupied_cells, spread
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Floor, Stair

TWO_FLOORS = (Floor("0", "ground", 0.0, 2.5), Floor("1", "upper", 2.7, 2.5))


@pytest.fixture(scope="module")
def plain(boxes, room):
    """A room of 6 x 4 m with a wall at x = 3 from y = 0 to 3: the only way round is past its end."""
    wall = ("wall", "0", (2.95, 0.0, 0.0), (3.05, 3.0, 2.5))
    return NavigationMap.build(boxes([*room(6.0, 4.0), wall]))


def distance_m(nav, p_world, floor, goals) -> float:
    """Length of the shortest way to the nearest goal."""
    return nav.distance_field(goals).at(p_world, floor)


# ---- kernels against slow references ---------------------------------------------------------------------------


def _random_grid(rng: np.random.Generator, size: int) -> np.ndarray:
    free = np.ones((size, size), dtype=np.bool_)
    for _ in range(rng.integers(2, 8)):
        r, c = rng.integers(0, size, 2)
        h, w = rng.integers(1, size // 3, 2)
        free[r : r + h, c : c + w] = False
    return free


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.tuples(*[st.floats(0.01, 11.99)] * 4))
def test_first_blocked_agrees_with_walking_in_tiny_steps(seed: int, line: tuple[float, float, float, float]) -> None:
    free = _random_grid(np.random.default_rng(seed), 12)
    row0, col0, row1, col1 = line
    share = first_blocked(free, row0, col0, row1, col1)
    t = np.linspace(0.0, 1.0, 5001)
    cells = np.floor(np.stack([row0 + t * (row1 - row0), col0 + t * (col1 - col0)])).astype(int)
    inside = free[cells[0], cells[1]]
    walked = t[np.argmin(inside)] if not inside.all() else 2.0
    assert share <= walked + 1e-9
    if share < 1.0:
        assert inside[t < share - 1e-6].all()
        p = np.array([row0 + share * (row1 - row0), col0 + share * (col1 - col0)])
        # Through a corner, or cutting one by less than a step of the walk: only the kernel sees that.
        at_corner = np.abs(p - np.round(p)).max() < 0.01
        assert at_corner or walked - share < 3e-4


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ((0.5, 0.5, 0.5, 3.5), 0.5),  # into the block at (0, 2): 1.5 of 3 cells
        ((1.5, 0.5, 1.5, 3.5), 2.0),
        ((0.5, 2.5, 1.5, 2.5), 0.0),  # starts blocked
        ((1.5, 1.5, 1.5, 9.5), 2.5 / 8.0),  # leaves the grid
        ((1.5, 1.5, 0.5, 0.5), 2.0),  # through a corner, both sides free
        ((1.5, 1.5, 0.5, 2.5), 0.5),  # diagonally into the block
        ((1.5, 2.5, 0.5, 3.5), 0.5),  # past the block's corner
    ],
)
def test_first_blocked_by_table(line, expected) -> None:
    free = np.ones((2, 4), dtype=np.bool_)
    free[0, 2] = False
    assert first_blocked(free, *line) == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(4))
def test_distances_against_the_exact_visibility_graph(seed: int) -> None:
    free = _random_grid(np.random.default_rng(seed), 16)
    cells = np.argwhere(free)
    graph = np.zeros((len(cells), len(cells)))
    for i, a in enumerate(cells):
        for j in range(i):
            if first_blocked(free, *(a + 0.5), *(cells[j] + 0.5)) > 1.0:
                graph[i, j] = graph[j, i] = math.hypot(*(a - cells[j]))
    exact = dijkstra(graph, indices=0)
    found, _ = spread(free, np.array([cells[0] @ [16, 1]]), np.zeros(1))
    found = found.reshape(free.shape)[free]
    assert np.array_equal(np.isinf(found), np.isinf(exact))
    reached = np.isfinite(exact)
    assert (found[reached] >= exact[reached] - 1e-9).all()
    assert (found[reached] - exact[reached]).max() <= 0.7
    assert found[reached].sum() <= 1.002 * exact[reached].sum()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(*[st.floats(0.2, 9.8)] * 2, st.floats(-1.0, 2.0)), min_size=3, max_size=3))
def test_marked_cells_are_those_a_triangle_touches_in_the_slab(corners) -> None:
    vertices = np.array(corners, dtype=np.float32)
    grid = Grid(0.0, 0.0, 1.0, rows=10, cols=10)
    marked = occupied_cells(grid, vertices, np.array([[0, 1, 2]], dtype=np.int32), 0.0, 1.0)
    u, v = np.meshgrid(np.linspace(0, 1, 120), np.linspace(0, 1, 120))
    inside = u + v <= 1
    a, b, c = vertices.astype(np.float64)
    points = a + u[inside][:, None] * (b - a) + v[inside][:, None] * (c - a)
    points = points[(points[:, 2] > 1e-6) & (points[:, 2] < 1.0 - 1e-6)]
    for x, y, _ in points:
        if min(abs(x - round(x)), abs(y - round(y))) > 1e-6:  # on a boundary rounding decides
            assert marked[int(y), int(x)]
    # And no others: each marked cell has a sample nearby, as far as the slab is thick enough to be sampled.
    if len(points) > 500:
        for row, col in np.argwhere(marked):
            gap = np.maximum(np.abs(points[:, :2] - [col + 0.5, row + 0.5]) - 0.5, 0.0)
            assert np.hypot(gap[:, 0], gap[:, 1]).min() < 0.25


# ---- where a robot can stand -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "blocks"),
    [
        ((2.0, 2.0, 0.0), (2.5, 2.5, 0.05), False),  # a carpet
        ((2.0, 2.0, 0.0), (2.5, 2.5, 0.3), True),  # a footstool
        ((2.0, 2.0, 0.70), (2.5, 2.5, 0.75), True),  # a table's top without legs
        ((2.0, 2.0, 1.2), (2.5, 2.5, 2.0), False),  # a cupboard that hangs above the robot
        ((2.24, 2.24, 0.0), (2.25, 2.25, 2.4), True),  # a pole of 1 cm
        ((2.1, 2.1, -0.5), (2.4, 2.4, 2.6), True),  # a pillar through floor and ceiling
    ],
)
def test_what_blocks(boxes, room, low, high, blocks) -> None:
    nav = NavigationMap.build(boxes([*room(4.0, 4.0), ("", "0", low, high)]))
    assert nav.is_navigable((2.25, 2.25), "0") is not blocks
    assert nav.is_navigable((2.25, 2.25 + 0.25 + 0.18 + 0.1), "0")
    assert nav.is_navigable((2.25, low[1] - 0.1), "0") is not blocks


def test_a_hole_in_the_floor_carries_nobody(boxes) -> None:
    around = [((0, 0), (4, 1.5)), ((0, 2.5), (4, 4)), ((0, 1.5), (1.5, 2.5)), ((2.5, 1.5), (4, 2.5))]
    nav = NavigationMap.build(boxes([("floor", "0", (*a, -0.1), (*b, 0.0)) for a, b in around]))
    floor = nav.floors["0"]
    assert nav.is_navigable((2.0, 1.2), "0")
    assert not nav.is_navigable((2.0, 1.45), "0")
    assert not nav.is_navigable((2.0, 2.0), "0")
    assert floor.floor_area_m2 == pytest.approx(15.0, abs=0.4)


def test_the_inside_of_furniture_is_not_where_robots_live(boxes, room) -> None:
    wardrobe = ("", "0", (1.0, 1.0, 0.0), (2.5, 2.0, 2.2))
    nav = NavigationMap.build(boxes([*room(4.0, 4.0), wardrobe]))
    row, col = nav.floors["0"].grid.cells_of((1.75, 1.5))
    assert not nav.robot_area["0"][row, col]
    assert nav.floors["0"].component[row, col] != nav.floors["0"].largest_component


@settings(max_examples=200, deadline=None)
@given(x=st.floats(0.0, 6.0), y=st.floats(0.0, 4.0))
def test_free_is_a_radius_away_from_everything(plain, x: float, y: float) -> None:
    outside = min(x, 6.0 - x, y, 4.0 - y)
    to_wall = math.hypot(max(2.95 - x, 0.0, x - 3.05), max(0.0, y - 3.0))
    clearance = min(outside, to_wall)
    if plain.is_navigable((x, y), "0"):
        assert clearance > 0.18 - 0.05
    else:
        assert clearance < 0.18 + 0.09  # cells are 5 cm, obstacles swell to whole cells


def test_areas_and_random_points(plain) -> None:
    floor = plain.floors["0"]
    assert floor.floor_area_m2 == pytest.approx(6.2 * 4.2, rel=0.02)
    closed_form = (6 - 0.36) * (4 - 0.36) - (0.46 * 2.82 + math.pi * 0.18**2 / 2 + 0.1 * 0.18)
    assert float(floor.free.sum()) * floor.grid.resolution_m**2 == pytest.approx(closed_form, rel=0.06)
    rng = np.random.default_rng(0)
    points = np.array([plain.random_point(rng, "0") for _ in range(300)])
    assert all(plain.is_navigable(p, "0") for p in points)
    assert 0.35 < (points[:, 0] < 3.0).mean() < 0.65


def test_snap(plain) -> None:
    assert plain.snap((1.0, 1.0, 0.0), "0") == (1.0, 1.0, 0.0)
    x, y, z = plain.snap((3.0, 1.0, 0.0), "0")
    assert plain.is_navigable((x, y), "0")
    assert math.hypot(x - 3.0, y - 1.0) < 0.3
    assert z == 0.0
    assert plain.snap((3.0, 1.0, 0.0), "0", within_m=0.1) is None
    assert plain.snap((50.0, 50.0), "0") is None


# ---- distances -------------------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(ax=st.floats(0.3, 2.6), ay=st.floats(0.3, 3.6), bx=st.floats(3.4, 5.7), by=st.floats(0.3, 3.6))
def test_distance_round_the_end_of_a_wall_in_closed_form(plain, ax: float, ay: float, bx: float, by: float) -> None:
    """A disk goes straight, or round the wall's end: a rope around the end's two corners, each of radius 0.18."""
    p_goal = plain.floors["0"].grid.centres_of(plain.floors["0"].grid.cells_of((bx, by)))
    found = distance_m(plain, (ax, ay), "0", {"0": [p_goal]})
    exact = _rope((ax, ay), (float(p_goal[0]), float(p_goal[1])), ((2.95, 3.0), (3.05, 3.0)), 0.18)
    # Obstacles swell to whole cells and so do corners: the way may be 10 cm longer, and hardly shorter.
    assert exact - 0.05 <= found <= 1.005 * exact + 0.12


def _rope(a, b, corners, radius) -> float:
    """Length of a rope from a to b over the tops of two discs, by the shortest of many polygons (0.1 mm)."""
    angles = np.linspace(math.pi, 0.0, 181)
    arcs = [np.array([(cx + radius * math.cos(t), cy + radius * math.sin(t)) for t in angles]) for cx, cy in corners]
    points = np.concatenate([arcs[0][:91], arcs[1][90:]])  # the upper hull of both discs
    legs = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(legs)])
    from_a = np.hypot(*(points - a).T)
    to_b = np.hypot(*(points - b).T)
    tangent_a = [i for i in range(len(points)) if _clear(a, points[i], points)]
    tangent_b = [i for i in range(len(points)) if _clear(b, points[i], points)]
    best = min(from_a[i] + along[j] - along[i] + to_b[j] for i in tangent_a for j in tangent_b if j >= i)
    crossing = np.interp(3.0, [a[0], b[0]], [a[1], b[1]])
    return math.dist(a, b) if crossing >= 3.0 + radius and _clear(a, b, points) else best


def _clear(p, q, hull) -> bool:
    """Whether the segment p-q stays above the hull."""
    p, q = np.array(p), np.array(q)
    between = (hull[:, 0] > min(p[0], q[0])) & (hull[:, 0] < max(p[0], q[0]))
    if not between.any():
        return True
    t = (hull[between, 0] - p[0]) / (q[0] - p[0])
    return bool((p[1] + t * (q[1] - p[1]) >= hull[between, 1] - 1e-6).all())


@settings(max_examples=60, deadline=None)
@given(ax=st.floats(0.3, 2.6), ay=st.floats(0.3, 3.6), bx=st.floats(0.3, 2.6), by=st.floats(0.3, 3.6))
def test_in_sight_the_distance_is_the_straight_line(plain, ax, ay, bx, by) -> None:
    grid = plain.floors["0"].grid
    goal = grid.centres_of(grid.cells_of((bx, by)))
    found = distance_m(plain, (ax, ay), "0", {"0": [goal]})
    assert found == pytest.approx(math.dist((ax, ay), goal), abs=1e-5)


def test_a_way_is_free_and_as_long_as_its_distance(plain) -> None:
    goals = {"0": [(5.525, 0.525), (5.525, 1.525)]}
    way = plain.distance_field(goals).path_from((0.5, 0.5), "0")
    points = [(w.x_m, w.y_m) for w in way]
    assert points[0] == (0.5, 0.5)
    assert points[-1] == pytest.approx((5.525, 1.525))
    length = sum(math.dist(a, b) for a, b in pairwise(points))
    assert length == pytest.approx(distance_m(plain, (0.5, 0.5), "0", goals), abs=1e-4)
    assert all(plain.way_free(a, b, "0") == 1.0 for a, b in pairwise(points))


def test_no_way_is_infinite(boxes, room) -> None:
    wall = ("wall", "0", (2.95, 0.0, 0.0), (3.05, 4.0, 2.5))
    nav = NavigationMap.build(boxes([*room(6.0, 4.0), wall]))
    assert distance_m(nav, (1, 1), "0", {"0": [(5, 1)]}) == math.inf
    assert nav.distance_field({"0": [(5, 1)]}).path_from((1, 1), "0") == []
    assert distance_m(nav, (1, 1), "0", {"0": [(3, 1)]}) == math.inf, "a goal inside the wall is none"
    assert distance_m(nav, (3, 1), "0", {"0": [(1, 1)]}) == math.inf, "a start inside the wall"
    assert distance_m(nav, (1, 1), "0", {}) == math.inf
    assert distance_m(nav, (-9, 1), "0", {"0": [(1, 1)]}) == math.inf
    assert nav.floors["0"].component.max() == 2


# ---- floors ----------------------------------------------------------------------------------------------------


def test_stairs_join_floors_by_their_length(boxes, room) -> None:
    stairs = (
        Stair("0", "1", (1.025, 1.025, 0.0), (2.025, 1.025, 2.7), 4.0),
        Stair("0", "1", (5.025, 1.025, 0.0), (5.025, 3.025, 2.7), 1.0),
    )
    nav = NavigationMap.build(boxes([*room(6, 4), *room(6, 4, "1", 2.7)], TWO_FLOORS, stairs))
    assert [t.length_m for t in nav.transits] == [4.0, 1.0]
    # Over the short stair: 4 m there, 1 m up, 3 m back and 2 m aside, as the crow flies on each floor.
    goal = (2.025, 1.025)
    expected = 4.0 + 1.0 + math.dist((5.025, 3.025), goal)
    long_way = 4.0
    assert distance_m(nav, (1.025, 1.025), "0", {"1": [goal]}) == pytest.approx(min(expected, long_way), abs=1e-4)
    far = (4.025, 3.025)
    assert distance_m(nav, (3.025, 1.025), "0", {"1": [far]}) == pytest.approx(2.0 + 1.0 + 1.0, abs=1e-4)
    way = nav.distance_field({"1": [far]}).path_from((3.025, 1.025), "0")
    assert [w.floor for w in way] == ["0", "0", "1", "1"]
    # A goal upstairs may be reached from upstairs by going down and up again only if that is shorter.
    assert distance_m(nav, (1.025, 2.025), "1", {"1": [far]}) == pytest.approx(math.dist((1.025, 2.025), far), abs=1e-4)  # fmt: skip  # noqa: E501


@pytest.mark.parametrize("lengths", [(1.0, 5.0), (5.0, 1.0)])
def test_of_two_stairs_the_shorter_is_taken(boxes, room, lengths) -> None:
    stairs = tuple(Stair("0", "1", (1.025, 1.025, 0.0), (2.025, 1.025, 2.7), length) for length in lengths)
    nav = NavigationMap.build(boxes([*room(6, 4), *room(6, 4, "1", 2.7)], TWO_FLOORS, stairs))
    assert distance_m(nav, (1.025, 1.025), "0", {"1": [(2.025, 1.025)]}) == pytest.approx(1.0)


def test_floors_without_stairs_do_not_meet_and_robots_live_on_the_larger_one(boxes, room) -> None:
    nav = NavigationMap.build(boxes([*room(6, 4), *room(4, 4, "1", 2.7)], TWO_FLOORS))
    assert distance_m(nav, (1, 1), "0", {"1": [(1, 1)]}) == math.inf
    assert nav.robot_area["0"].any()
    assert not nav.robot_area["1"].any()
    with pytest.raises(BuildingError, match=r"can't get to floor '1'.*\['0'\]"):
        nav.random_point(np.random.default_rng(0), "1")


def test_robots_live_where_the_area_over_stairs_is_largest(boxes, room) -> None:
    """Downstairs 3 of 6 m are cut off; the smaller part has the stair and so, with upstairs, the larger area."""
    wall = ("wall", "0", (2.45, 0.0, 0.0), (2.55, 4.0, 2.5))
    stair = Stair("0", "1", (1.0, 1.0, 0.0), (3.0, 1.0, 2.7), 4.0)
    nav = NavigationMap.build(boxes([*room(6, 4), wall, *room(6, 4, "1", 2.7)], TWO_FLOORS, (stair,)))
    row, col = nav.floors["0"].grid.cells_of((1.0, 1.0))
    assert nav.robot_area["0"][row, col]
    row, col = nav.floors["0"].grid.cells_of((5.0, 1.0))
    assert not nav.robot_area["0"][row, col]
    assert nav.floors["0"].component[row, col] == 1


def test_robots_live_indoors_even_if_the_terrace_is_larger(boxes, room) -> None:
    terrace = ("floor", "0", (4.1, -0.1, -0.1), (20.0, 4.1, 0.0))
    nav = NavigationMap.build(boxes([*room(4.0, 4.0), terrace]))
    floor = nav.floors["0"]
    row, col = floor.grid.cells_of((2.0, 2.0))
    assert nav.robot_area["0"][row, col]
    row, col = floor.grid.cells_of((10.0, 2.0))
    assert floor.free[row, col]
    assert not nav.robot_area["0"][row, col]
    assert floor.floor_area_m2 == pytest.approx(4.2 * 4.2, rel=0.03)


def test_a_building_without_ceilings_is_all_indoors(boxes, room) -> None:
    scene = boxes([b for b in room(4.0, 4.0) if b[0] != "ceiling"] + [("", "0", (1.0, 1.0, 0.0), (1.5, 1.5, 1.8))])
    floor = NavigationMap.build(scene).floors["0"]
    assert np.array_equal(floor.indoor, floor.supported)


def test_a_stair_that_ends_in_a_wall_is_left_out_and_noted(boxes, room) -> None:
    stair = Stair("0", "1", (1.0, 1.0, 0.0), (30.0, 1.0, 2.7), 4.0)
    nav = NavigationMap.build(boxes([*room(6, 4), *room(6, 4, "1", 2.7)], TWO_FLOORS, (stair,)))
    assert nav.transits == ()
    assert nav.notes == ("the stair from 0 to 1 has no free place on 1",)


# ---- cache and limits ------------------------------------------------------------------------------------------


def test_the_cache_gives_back_what_was_built_and_survives_a_broken_file(boxes, room, tmp_path) -> None:
    scene = boxes([*room(4.0, 4.0), ("", "0", (1.0, 1.0, 0.0), (2.5, 2.0, 2.2))])
    built = NavigationMap.load_or_build(scene, tmp_path)
    (file,) = tmp_path.iterdir()
    for _ in range(2):
        again = NavigationMap.load_or_build(scene, tmp_path)
        assert again.floors["0"].grid == built.floors["0"].grid
        for name in ("free", "component", "supported", "indoor", "obstacle"):
            assert np.array_equal(getattr(again.floors["0"], name), getattr(built.floors["0"], name))
        file.write_bytes(b"PK\x03\x04 not a zip")
    other = dataclasses.replace(scene, content_hash="other")
    NavigationMap.load_or_build(other, tmp_path)
    NavigationMap.load_or_build(scene, tmp_path, radius_m=0.3)
    NavigationMap.load_or_build(dataclasses.replace(scene, content_hash=""), tmp_path)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_building_in_millimetres_is_refused(boxes, room) -> None:
    with pytest.raises(BuildingError, match=r"6000 x 4000 m.*unit metres"):
        NavigationMap.build(boxes(room(6000.0, 4000.0)))


def test_what_makes_a_building_too_large_is_named(boxes, room) -> None:
    tree = ("tree", "0", (-9001.0, 2.0, 0.0), (-9000.0, 3.0, 4.0))
    with pytest.raises(BuildingError, match=r"'tree-7', from \(-9001, 2\) to \(-9000, 3\) m: 9,00\d m"):
        NavigationMap.build(boxes([*room(6.0, 4.0), tree]))
