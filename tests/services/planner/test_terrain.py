"""The travel-time field against a slow reference, and where terrain lets a robot go."""

from __future__ import annotations

import heapq
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Grid
from surveilnav.occupancy import ESTIMATED_OBSTACLE, PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView
from surveilnav.services.planner.core.motion.drive import FmmPlanner, descend, next_action
from surveilnav.services.planner.core.motion.terrain import (
    build_terrain,
    coarse_travel_time_m,
    travel_time_m,
    travel_times_between_m,
)

CONFIG = PlannerConfig()


def mission(**here):
    """A mission that remembers this of floor 0."""
    return MissionState("x", floor="0", floors={"0": FloorMemory(**here)})


NEIGHBOURS = [(dr, dc) for dr in range(-3, 4) for dc in range(-3, 4) if math.gcd(dr, dc) == 1]


def dijkstra_m(speed, sources, resolution_m):
    """The literal reference: shortest travel time on a graph of many directions. It never undercuts the true field."""
    cost = np.full(speed.shape, np.inf)
    queue = [(0.0, int(r), int(c)) for r, c in np.argwhere(sources & (speed > 0))]
    for _, r, c in queue:
        cost[r, c] = 0.0
    while queue:
        t, r, c = heapq.heappop(queue)
        if t > cost[r, c]:
            continue
        for dr, dc in NEIGHBOURS:
            n = max(abs(dr), abs(dc)) * 2
            line = [(round(r + dr * i / n), round(c + dc * i / n)) for i in range(n + 1)]
            if not (0 <= r + dr < speed.shape[0] and 0 <= c + dc < speed.shape[1]):
                continue
            box = speed[min(r, r + dr) : max(r, r + dr) + 1, min(c, c + dc) : max(c, c + dc) + 1]
            if (box <= 0).any():  # no corner is cut
                continue
            slow = np.mean([1.0 / speed[cell] for cell in line])
            new = t + math.hypot(dr, dc) * resolution_m * slow
            if new < cost[r + dr, c + dc] - 1e-12:
                cost[r + dr, c + dc] = new
                heapq.heappush(queue, (new, r + dr, c + dc))
    return cost


def fast_marching_m(speed, sources, resolution_m):
    """The tidy reference: first order, cells settled one by one in the order of a heap (Sethian 1996)."""
    time, settled = np.full(speed.shape, np.inf), np.zeros(speed.shape, bool)
    time[sources & (speed > 0)] = 0.0
    queue = [(0.0, int(r), int(c)) for r, c in np.argwhere(time == 0.0)]

    def upwind(r, c):
        inside = 0 <= r < speed.shape[0] and 0 <= c < speed.shape[1]
        return time[r, c] if inside and settled[r, c] else np.inf

    while queue:
        _, row, col = heapq.heappop(queue)
        if settled[row, col]:
            continue
        settled[row, col] = True
        for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
            if not (0 <= r < speed.shape[0] and 0 <= c < speed.shape[1]) or speed[r, c] <= 0 or settled[r, c]:
                continue
            low, high = sorted((min(upwind(r - 1, c), upwind(r + 1, c)), min(upwind(r, c - 1), upwind(r, c + 1))))
            cell_m = resolution_m / speed[r, c]
            # (t - low)^2 + (t - high)^2 = cell_m^2, or from one side where the other comes too late.
            new = (
                low + cell_m
                if high - low >= cell_m
                else (low + high + math.sqrt(2 * cell_m**2 - (high - low) ** 2)) / 2
            )
            if new < time[r, c]:
                time[r, c] = new
                heapq.heappush(queue, (new, r, c))
    return time


def maze(seed, n=48):
    """Speeds with walls three cells thick and gaps, all reachable places known to the reference."""
    rng = np.random.default_rng(seed)
    speed = np.ones((n, n))
    for _ in range(3):
        at, gap = int(rng.integers(8, n - 8)), int(rng.integers(2, n - 12))
        wall = (slice(at, at + 3), slice(None)) if rng.random() < 0.5 else (slice(None), slice(at, at + 3))
        speed[wall] = 0.0
        hole = slice(gap, gap + 9)
        speed[(wall[0], hole) if wall[1] == slice(None) else (hole, wall[1])] = 1.0
    speed[speed > 0] = rng.choice([0.5, 1.0], size=int((speed > 0).sum()), p=[0.1, 0.9])
    return speed


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000))
def test_field_agrees_with_dijkstra(seed):
    speed = maze(seed)
    open_cells = np.argwhere(speed > 0)
    sources = np.zeros(speed.shape, bool)
    sources[tuple(open_cells[seed % len(open_cells)])] = True
    fast, slow = travel_time_m(speed, sources, 0.05), dijkstra_m(speed, sources, 0.05)
    assert np.array_equal(np.isfinite(fast), np.isfinite(slow))
    far = np.isfinite(slow) & (slow > 0.5)
    assert np.abs(fast[far] - slow[far]).max(initial=0.0) < 0.12 + 0.1 * slow[far].max(initial=0.0)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_field_is_as_good_as_a_tidy_queue(seed):
    """The buckets cost under half a cell of way plus 2 % of it."""
    speed = maze(seed)
    open_cells = np.argwhere(speed > 0)
    sources = np.zeros(speed.shape, bool)
    sources[tuple(open_cells[seed % len(open_cells)])] = True
    own, tidy = travel_time_m(speed, sources, 0.05), fast_marching_m(speed, sources, 0.05)
    reached = np.isfinite(tidy)
    assert np.array_equal(reached, np.isfinite(own))
    assert (np.abs(own[reached] - tidy[reached]) <= 0.025 + 0.02 * own[reached]).all()


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_a_front_that_stops_early_says_the_same_up_to_there(seed):
    speed = maze(seed)
    open_cells = np.argwhere(speed > 0)
    sources = np.zeros(speed.shape, bool)
    sources[tuple(open_cells[seed % len(open_cells)])] = True
    there = tuple(int(v) for v in open_cells[(seed * 7) % len(open_cells)])
    whole, part = travel_time_m(speed, sources, 0.05), travel_time_m(speed, sources, 0.05, [[there]], 0.3)
    assert part[there] == whole[there]
    assert np.array_equal(part[np.isfinite(part)], whole[np.isfinite(part)])
    if math.isfinite(whole[there]):
        assert np.isfinite(part[whole < whole[there] + 0.25]).all()
        assert not np.isfinite(part[whole > whole[there] + 0.4]).any()


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_a_front_that_stops_goes_on_to_the_last_of_several_places(seed):
    """Places may share cells, and one that no way leads to keeps the front going everywhere."""
    rng, speed = np.random.default_rng(seed), maze(seed)
    sources = np.zeros(speed.shape, bool)
    sources[tuple(rng.permutation(np.argwhere(speed > 0))[0])] = True
    places = [rng.integers(0, 48, (4, 2)) for _ in range(3)]
    places[1][0] = places[0][0]
    whole, part = travel_time_m(speed, sources, 0.05), travel_time_m(speed, sources, 0.05, places, 0.05)
    least_m = [whole[cells[:, 0], cells[:, 1]].min() for cells in places]
    assert [part[cells[:, 0], cells[:, 1]].min() for cells in places] == least_m
    assert np.array_equal(part[np.isfinite(part)], whole[np.isfinite(part)])
    assert not np.isfinite(part[whole > max(least_m) + 0.15]).any()


def test_open_space_is_a_cone():
    """First order: a few per cent too far beside the axes, and never too near."""
    speed, sources = np.ones((161, 161)), np.zeros((161, 161), bool)
    sources[80, 80] = True
    row, col = np.mgrid[:161, :161]
    true = np.hypot(row - 80, col - 80) * 0.05
    error = travel_time_m(speed, sources, 0.05) - true
    assert error.min() > -0.01
    assert error[true > 1.0].max() < 0.12
    assert (error / np.maximum(true, 0.05))[true > 2.0].max() < 0.04


@settings(max_examples=6)
@given(seed=st.integers(0, 10_000))
def test_driving_is_as_short_as_by_a_tidy_field(seed):
    """Whole drives through mazes: the same goal, and a way within 2 % (and one step) of that by the tidy field."""
    speed = np.kron(maze(seed, 40), np.ones((3, 3)))
    grid = Grid(0.0, 0.0, 0.05, *speed.shape)
    terrain = replace(
        build_terrain(_maps(grid, np.zeros(grid.shape, np.uint8)), _robot(1.0, 1.0), MissionState("x"), CONFIG),
        speed=speed,
    )
    open_cells = np.argwhere(speed == 1.0)
    x, y = terrain.centre_of(*(int(v) for v in open_cells[seed % len(open_cells)]))
    gx, gy = terrain.centre_of(*(int(v) for v in open_cells[(seed * 13 + 5) % len(open_cells)]))
    goals = terrain.disc(gx, gy, 0.3) & (speed > 0)

    field = fast_marching_m(speed, goals, 0.05)

    def tidy(terrain, goals, robot):
        reached = np.isfinite(field[terrain.cell(robot.x_m, robot.y_m)])
        return next_action(terrain, field, robot, CONFIG) if reached else None

    def own(terrain, goals, robot):
        route = FmmPlanner().route(terrain, goals, robot, CONFIG)
        return route and route.action

    def drive(choose):
        robot, way_m = _robot(x, y), 0.0
        for _ in range(400):
            if goals[terrain.cell(robot.x_m, robot.y_m)]:
                return way_m
            action = choose(terrain, goals, robot)
            if action is None:
                return None
            if action == "move_forward":
                c, s = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
                robot, way_m = replace(robot, x_m=robot.x_m + 0.25 * c, y_m=robot.y_m + 0.25 * s), way_m + 0.25
            else:
                turn = CONFIG.turn_rad if action == "turn_left" else -CONFIG.turn_rad
                robot = replace(robot, yaw_rad=robot.yaw_rad + turn)
        raise AssertionError("never arrived")

    ours, theirs = drive(own), drive(tidy)
    assert (ours is None) == (theirs is None)
    if ours is not None:
        assert ours <= 1.02 * theirs + 0.25 + 1e-9


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000))
def test_descent_reaches_the_source_and_crosses_nothing(seed):
    speed = maze(seed)
    grid = Grid(0.0, 0.0, 0.05, *speed.shape)
    terrain = build_terrain(_maps(grid, np.zeros(grid.shape, np.uint8)), _robot(1.0, 1.0), MissionState("x"), CONFIG)
    open_cells = np.argwhere(speed > 0)
    source = tuple(open_cells[seed % len(open_cells)])
    sources = np.zeros(speed.shape, bool)
    sources[source] = True
    field = travel_time_m(speed, sources, 0.05)
    start = np.argwhere(np.isfinite(field))[-1]
    path = np.array(descend(terrain, field, int(start[0]), int(start[1])))
    assert tuple(grid.cells_of(path[-1])) == source
    t = np.linspace(0, 1, 9)[:, None, None]
    between = (path[:-1] + t * (path[1:] - path[:-1])).reshape(-1, 2)
    cells = grid.cells_of(np.vstack([path, between]))
    assert (speed[cells[:, 0], cells[:, 1]] > 0).mean() > 0.98  # a kept point every other cell may graze a corner


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_coarse_reaches_what_fine_reaches(seed):
    """And never says that it is farther. Where it may be nearer: a tight place is as dear as the best of four cells."""
    rng = np.random.default_rng(seed)
    occupancy = np.zeros((120, 120), np.uint8)
    for _ in range(6):
        r, c = rng.integers(10, 110, 2)
        occupancy[r, max(0, c - 30) : c + 30] = 1
    terrain = build_terrain(
        _maps(Grid(0.0, 0.0, 0.05, 120, 120), occupancy), _robot(0.3, 0.3), MissionState("x"), CONFIG
    )
    without_tight = replace(terrain, speed=np.where(terrain.speed < CONFIG.wall_speed, 0.0, terrain.speed))
    for ground, share in ((terrain, 0.25), (without_tight, 0.03)):
        sources = np.zeros(ground.grid.shape, bool)
        sources[ground.cell(0.3, 0.3)] = True
        fine, coarse = travel_time_m(ground.speed, sources, 0.05), coarse_travel_time_m(ground, 0.3, 0.3)
        both = np.isfinite(fine)
        assert np.isfinite(coarse[both]).all()
        assert (coarse[both] - fine[both]).max() < 0.4 + 0.2 * fine[both].max()
        assert np.median(np.abs(coarse[both] - fine[both]) / np.maximum(fine[both], 1.0)) < share


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_times_between_places_are_those_of_whole_fields(seed):
    """To the last bit, although the fronts end early; also of places in obstacles, and of two at the same place."""
    rng = np.random.default_rng(seed)
    occupancy = np.zeros((120, 120), np.uint8)
    for _ in range(6):
        r, c = rng.integers(10, 110, 2)
        occupancy[r : r + 12, max(0, c - 30) : c + 30] = 1
    terrain = build_terrain(
        _maps(Grid(0.0, 0.0, 0.05, 120, 120), occupancy), _robot(0.3, 0.3), MissionState("x"), CONFIG
    )
    places = [tuple(place) for place in rng.uniform(0.0, 6.0, (4, 2))]
    places.append(places[0])
    fields = [coarse_travel_time_m(terrain, *place) for place in places]
    expected = np.array([[terrain.min_near(field, *place, 0.3) for place in places] for field in fields])
    np.fill_diagonal(expected, 0.0)
    assert np.array_equal(travel_times_between_m(terrain, places, 0.3), expected)


@pytest.mark.parametrize(("gap_m", "passes"), [(0.8, True), (0.6, True), (0.35, True), (0.1, False)])
def test_doorways(gap_m, passes):
    occupancy = np.zeros((100, 100), np.uint8)
    occupancy[:, 50:53] = 1
    n = round(gap_m / 0.05)
    occupancy[50 - n // 2 : 50 - n // 2 + n, 50:53] = 0
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    terrain = build_terrain(_maps(grid, occupancy), _robot(1.0, 2.5), MissionState("x"), CONFIG)
    goals = terrain.disc(4.0, 2.5, 0.2)
    assert (FmmPlanner().route(terrain, goals, _robot(1.0, 2.5), CONFIG) is not None) == passes


def test_collisions_block_and_visits_open():
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    occupancy = np.zeros(grid.shape, np.uint8)
    occupancy[40:44, 40:44] = 1
    state = mission(collisions=[(1.0, 1.0)], visited=[(2.1, 1.85)])
    terrain = build_terrain(_maps(grid, occupancy), _robot(4.0, 4.0), state, CONFIG)
    assert terrain.speed[terrain.cell(1.0, 1.0)] == 0
    assert terrain.speed[terrain.cell(1.1, 1.0)] == 1  # it is the centre that can't be there: nothing grows
    assert terrain.speed[terrain.cell(2.1, 1.9)] > 0  # it stood here, so it can be here


def test_a_bump_shuts_one_heading_at_one_spot():
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    free = _maps(grid, np.zeros(grid.shape, np.uint8))
    robot = _robot(1.0, 2.5)
    goals = build_terrain(free, robot, MissionState("x"), CONFIG).disc(4.0, 2.5, 0.2)

    def action(bumps):
        terrain = build_terrain(free, robot, mission(bumps=bumps), CONFIG)
        return FmmPlanner().route(terrain, goals, robot, CONFIG).action

    assert action([]) == "move_forward"
    assert action([(1.0, 2.5, 0.0)]).startswith("turn")
    assert action([(1.0, 2.5, 1.0)]) == "move_forward"
    assert action([(1.1, 2.5, 0.0)]) == "move_forward"


def test_tight_places_are_a_last_resort():
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    occupancy = np.zeros(grid.shape, np.uint8)
    occupancy[:, 50:53] = 1
    occupancy[48:53, 50:53] = 0  # straight ahead, 0.25 m
    occupancy[80:96, 50:53] = 0  # far aside, 0.8 m
    robot = _robot(1.0, 2.5)
    terrain = build_terrain(_maps(grid, occupancy), robot, MissionState("x"), CONFIG)
    route = FmmPlanner().route(terrain, terrain.disc(4.0, 2.5, 0.2), robot, CONFIG)
    assert max(y for _, y in route.path) > 3.9


def test_goal_in_an_obstacle_is_no_way():
    grid = Grid(0.0, 0.0, 0.05, 60, 60)
    occupancy = np.zeros(grid.shape, np.uint8)
    occupancy[40:50, 40:50] = 1
    terrain = build_terrain(_maps(grid, occupancy), _robot(0.5, 0.5), MissionState("x"), CONFIG)
    goals = terrain.disc(2.25, 2.25, 0.05)
    assert FmmPlanner().route(terrain, goals, _robot(0.5, 0.5), CONFIG) is None


def _maps(grid, occupancy):
    explored = np.ones(grid.shape, np.uint8)
    value = np.full(grid.shape, np.nan, np.float32)
    return FloorMaps("0", 0.0, grid, occupancy, explored, np.zeros(grid.shape, np.uint8), value, [], 1)


def _robot(x, y, yaw=0.0):
    return RobotView(0, x, y, yaw, 0.0, "0", False, None, 0.0)


def test_an_obstacle_that_is_only_estimated_is_avoided_but_blocks_nothing():
    """A corridor of 1 m, closed by a ghost: the robot drives through; with a way around of 3 m more, it takes that."""
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    occupancy = np.ones(grid.shape, np.uint8)
    occupancy[40:60, 5:95] = 0
    occupancy[40:60, 48:52] = ESTIMATED_OBSTACLE
    sources = np.zeros(grid.shape, bool)
    sources[50, 90] = True

    def time_m():
        terrain = build_terrain(_maps(grid, occupancy), _robot(0.5, 2.5), MissionState("x"), CONFIG)
        return travel_time_m(terrain.speed, terrain.crop(sources), 0.05)[terrain.cell(0.5, 2.5)]

    through = time_m()
    terrain = build_terrain(_maps(grid, occupancy), _robot(0.5, 2.5), MissionState("x"), CONFIG)
    ghost = terrain.crop(occupancy == ESTIMATED_OBSTACLE)
    assert ghost.any()
    assert not (terrain.occupied | terrain.known)[ghost].any()
    assert np.isfinite(through)
    occupancy[60:85, 30:70] = 0
    around = time_m()
    occupancy[40:60, 48:52] = 0
    assert time_m() < around < through


def test_known_free_floor_is_driven_through_and_known_walls_are_not():
    """A map from before: the way is as good as through floor that was seen, and better than through the unknown."""
    grid = Grid(0.0, 0.0, 0.05, 100, 100)
    occupancy, explored = np.ones(grid.shape, np.uint8), np.zeros(grid.shape, np.uint8)
    occupancy[40:60, 5:95] = 0
    explored[40:60, 5:40] = 1
    sources = np.zeros(grid.shape, bool)
    sources[50, 90] = True

    def time_m():
        maps = replace(_maps(grid, occupancy), explored=explored)
        terrain = build_terrain(maps, _robot(0.5, 2.5), MissionState("x"), CONFIG)
        return travel_time_m(terrain.speed, terrain.crop(sources), 0.05)[terrain.cell(0.5, 2.5)], terrain

    through_unknown, _ = time_m()
    occupancy[40:60, 40:95] = PRIOR_FREE
    through_prior, terrain = time_m()
    assert terrain.known[terrain.cell(3.5, 2.5)]
    explored[40:60, 5:95] = 1
    occupancy[40:60, 5:95] = 0
    through_seen, _ = time_m()
    assert through_prior == pytest.approx(through_seen)
    assert through_prior < 0.9 * through_unknown
    occupancy[40:60, 48:52] = PRIOR_OBSTACLE
    blocked, terrain = time_m()
    assert blocked == math.inf
    assert terrain.occupied[terrain.cell(2.5, 2.5)]
