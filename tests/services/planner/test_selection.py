"""Which waypoint wins, as tables: frontiers by strategy, objects by evidence."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from surveilnav.geometry import Grid
from surveilnav.messages import Candidate, Stair
from surveilnav.occupancy import PRIOR_FREE
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView, reach, step
from surveilnav.services.planner.core.behaviours.approach_object import _describe, approach_object
from surveilnav.services.planner.core.behaviours.follow_route import follow_route
from surveilnav.services.planner.core.choice import Choice, choose
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import goal_region as regions
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.goals.frontiers import Frontier, find_frontiers, rank, values_differ_enough
from surveilnav.services.planner.core.goals.goal_region import footprint, goal_region
from surveilnav.services.planner.core.goals.objects import candidates, chance, promising
from surveilnav.services.planner.core.goals.verification import is_likely_enough, verify
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.memory.floor_memory import DismissedObject
from surveilnav.services.planner.core.memory.waypoint import CurrentWaypoint
from surveilnav.services.planner.core.motion.drive import Route
from surveilnav.services.planner.core.motion.terrain import build_terrain, coarse_travel_time_m
from surveilnav.services.planner.core.options.candidates import promising_candidates
from surveilnav.services.planner.core.options.confirmed_objects import confirmed_objects
from surveilnav.services.planner.core.options.frontiers import by_chance_per_metre
from surveilnav.services.planner.core.options.last_resort import accepted_object, last_resort

CONFIG = PlannerConfig(strategy="region")
HALL = """
##########################
#                        #
#                        #
#  R                 CC  #
#                    CC  #
#                        #
##########      ##########
#                        #
#                        #
##########################
"""
GRID = Grid(0.0, 0.0, 0.05, 200, 200)
HERE = RobotView(0, 5.0, 1.0, 0.0, 0.0, "0", False, None, 0.0)


def maps(frontier_cells=(), value=None, objects=(), occupancy=None):
    frontier = np.zeros(GRID.shape, np.uint8)
    for row, col in frontier_cells:
        frontier[row, col] = 1
    value = np.full(GRID.shape, np.nan, np.float32) if value is None else value
    occupancy = np.zeros(GRID.shape, np.uint8) if occupancy is None else occupancy
    return FloorMaps("0", 0.0, GRID, occupancy, np.ones(GRID.shape, np.uint8), frontier, value, objects, 1)


def two_frontiers(near_value, far_value):
    """One at 1 m, one at 4 m of way."""
    value = np.full(GRID.shape, np.nan, np.float32)
    for f, v in ((NEAR, near_value), (FAR, far_value)):
        row, col = GRID.cells_of((f.x_m, f.y_m))
        value[row, col] = v
    return maps(value=value)


NEAR, FAR = Frontier(1.0, 1.0, 20, 1.0), Frontier(5.0, 5.0, 20, 4.0)


@pytest.mark.parametrize(
    ("strategy", "near", "far", "winner"),
    [
        ("greedy", 0.1, 0.9, NEAR),
        ("region", 0.1, 0.9, FAR),
        ("region", 0.9, 0.1, NEAR),
        ("region", 0.300, 0.301, NEAR),  # no spread to speak of: the nearest
        ("region", math.nan, math.nan, NEAR),
        ("region", math.nan, 0.9, NEAR),  # one value says nothing about the other
    ],
)
def test_frontier_by_strategy(strategy, near, far, winner):
    ranked, _ = rank([NEAR, FAR], two_frontiers(near, far), "chair", PlannerConfig(strategy=strategy))
    assert (ranked[0].x_m, ranked[0].y_m) == (winner.x_m, winner.y_m)


def test_frontier_by_objects_near_it(make_record):
    hint = make_record(label="dining table", at=(5.2, 5.0), label_scores={"chair": 0.4})
    ranked, by_value = rank([NEAR, FAR], maps(objects=[hint]), "chair", PlannerConfig(strategy="object"))
    assert by_value
    assert ranked[0].x_m == FAR.x_m


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([], False),
        ([0.5], False),
        ([0.5, 0.5], False),
        ([0.1, 0.9], True),
        ([0.50, 0.56], False),
        ([math.nan, 0.1, 0.9], True),
    ],
)
def test_values_differ_enough(values, expected):
    assert values_differ_enough(np.array(values), CONFIG) == expected


def test_long_frontiers_are_cut_and_specks_left_out():
    line = [(100, c) for c in range(20, 140)] + [(10, 10), (10, 11)]
    m = maps(line)
    terrain = build_terrain(m, HERE, MissionState("chair"), CONFIG)
    found = find_frontiers(m, terrain, coarse_travel_time_m(terrain, HERE.x_m, HERE.y_m), CONFIG)
    assert len(found) == 3
    assert sum(f.n_cells for f in found) == 120
    assert all(abs(f.y_m - 5.025) < 1e-9 and f.travel_time_m > 3.5 for f in found)


def test_where_a_map_from_before_knows_how_much_is_hidden_that_counts():
    """Two frontiers alike and equally far: behind one the map has a room, behind the other a niche."""
    pieces = [(100, c) for c in range(40, 60)] + [(100, c) for c in range(140, 160)]
    occupancy = np.zeros(GRID.shape, np.uint8)
    occupancy[101:141, 20:80] = PRIOR_FREE  # 6 m2
    occupancy[101:105, 145:155] = PRIOR_FREE
    m = maps(pieces, occupancy=occupancy)
    terrain = build_terrain(m, HERE, MissionState("chair"), CONFIG)
    found = find_frontiers(m, terrain, coarse_travel_time_m(terrain, HERE.x_m, HERE.y_m), CONFIG)
    room, niche = sorted(found, key=lambda f: f.x_m)
    assert room.hidden_m2 > 4.0
    assert niche.hidden_m2 == pytest.approx(0.1, abs=0.01)
    ranked, _ = rank([niche, room], m, "chair", CONFIG)
    assert ranked[0].x_m == room.x_m
    plain = maps(pieces)
    terrain = build_terrain(plain, HERE, MissionState("chair"), CONFIG)
    assert all(math.isnan(f.hidden_m2) for f in find_frontiers(plain, terrain, np.ones(terrain.grid.shape), CONFIG))


def test_given_up_twice_is_for_good():
    state = MissionState("chair")
    state.blacklist_place(1.0, 1.0, CONFIG)
    assert state.is_blacklisted(1.1, 1.0, CONFIG)
    assert not state.is_blacklisted(2.0, 1.0, CONFIG)
    assert state.here.blacklist.is_waiting(state.step)
    assert not state.is_blacklisted(1.0, 1.0, CONFIG, permanently=True)
    state.step += CONFIG.blacklist_steps
    assert not state.is_blacklisted(1.0, 1.0, CONFIG)
    assert not state.here.blacklist.is_waiting(state.step)
    state.blacklist_place(1.05, 1.0, CONFIG)
    state.step += CONFIG.blacklist_steps
    assert state.is_blacklisted(1.0, 1.0, CONFIG)
    assert not state.is_blacklisted(1.0, 1.0, CONFIG, confirmed=True)  # a confirmed target has more tries


@pytest.mark.parametrize(
    ("facts", "weak", "taken"),
    [
        ({"status": "confirmed"}, False, True),
        ({"status": "candidate", "confidence": 0.3}, False, True),
        ({"status": "candidate", "confidence": 0.05, "n_detections": 1}, False, False),
        ({"status": "candidate", "confidence": 0.05, "n_detections": 1}, True, True),
        ({"status": "rejected", "confidence": 0.9}, True, False),
        ({"label": "bed", "confidence": 0.9}, True, False),
        ({"label": "bed", "confidence": 0.9, "label_scores": {"chair": 0.4}}, False, True),
        ({"label": "bed", "status": "confirmed", "label_scores": {"chair": 0.4}}, False, False),
        ({"size": (math.nan, 1.0)}, True, False),
    ],
)
def test_candidates_and_promising_ones(make_record, facts, weak, taken):
    among = candidates if weak else promising
    found = among([make_record(**facts)], MissionState("chair"), CONFIG)
    assert bool(found) == taken


def test_confirmed_comes_first_and_dismissed_stays_out(make_record):
    a = make_record(id=1, confidence=0.9, at=(1, 1))
    b = make_record(id=2, confidence=0.6, status="confirmed", at=(3, 3))
    again = make_record(id=3, confidence=0.9, at=(3.1, 3))  # the dismissed one under a new id
    state = MissionState("chair")
    assert promising([a, b, again], state, CONFIG)[0].id == 2
    state.here.dismissed[2] = DismissedObject(3.0, 3.0, "no")
    assert [o.id for o in promising([a, b, again], state, CONFIG)] == [1]
    seen = make_record(id=3, at=(3.1, 3), label_robot="chair", confidence_robot=0.8)
    assert [o.id for o in promising([seen], state, CONFIG)] == [3]


def test_after_a_source_was_taken_out_of_the_maps_object_ids_mean_other_objects(make_record):
    state = MissionState("chair")
    state.here.dismissed[2] = DismissedObject(3.0, 3.0, "no")
    state.here.record_inspection(2, 3)
    state.here.record_extra_look(2)
    state.here.oscillations[2] = 2
    state.here.accepted_object, state.here.is_searched = 2, True
    state.waypoint = CurrentWaypoint("candidate", 3.0, 3.0, None, 1, object_id=2)
    before = state.copy()
    state.record_removals(0)
    assert state == before, "nothing was taken out"
    state.record_removals(1)
    here = state.here
    assert (here.accepted_object, here.inspection_turns, here.extra_looks, here.oscillations) == (None, {}, {}, {})
    assert (state.waypoint, here.is_searched) == (None, False)
    other, same_place = make_record(id=2, confidence=0.9, at=(7, 7)), make_record(id=1, confidence=0.9, at=(3, 3))
    assert [o.id for o in promising([other, same_place], state, CONFIG)] == [2], (
        "its place stays dismissed, its id doesn't"
    )
    assert MissionState.from_json(state.to_json()) == state
    state.waypoint = CurrentWaypoint("frontier", 3.0, 3.0, None, 1)
    state.record_removals(2)
    assert state.waypoint is not None


@pytest.mark.parametrize("low", [0.2, 0.1])
def test_views_that_disagree_do_not_turn_the_robot_to_and_fro(world, thing, low):
    """A candidate that is promising in every other view: the robot is on its way to it or it isn't."""
    w = world(HALL, {"C": thing("chair", known={"label": "chair", "confidence": 0.3})})
    objects = w.objects

    def wavering():
        score = 0.27 if w.seq % 2 else low
        return [msgspec.structs.replace(o, confidence=score, confidence_surveillance=score) for o in objects()]

    w.objects = wavering
    phases = []
    w.run(max_steps=43, config=CONFIG, watch=lambda m, r, s, d: phases.append(d.phase))  # then it is dismissed for good
    explores = [phase == "exploring" for phase in phases]
    assert sum(a != b for a, b in itertools.pairwise(explores)) <= 4, phases


ROBOT = {"label_robot": "chair", "confidence_robot": 0.6}
BED = {"label_robot": "bed"}
CAMERAS = {"label_surveillance": "chair", "confidence_surveillance": 0.9, "confidence": 0.9, "n_detections": 5}


@pytest.mark.parametrize(
    ("facts", "config", "expected", "enough"),
    [
        ({"status": "confirmed", **ROBOT}, CONFIG, "verified", False),
        ({"status": "candidate", **ROBOT}, CONFIG, "open", False),
        ({"status": "candidate", **ROBOT, "confidence": 0.75}, CONFIG, "open", True),  # likely, after all looks
        ({"status": "confirmed", **CAMERAS}, CONFIG, "open", True),
        ({"status": "candidate", **CAMERAS, "confidence": 0.65}, CONFIG, "open", False),
        ({"status": "confirmed", **CAMERAS}, PlannerConfig(verification="paper"), "verified", False),
        ({"status": "rejected", **ROBOT}, CONFIG, "contradicted", False),
        ({"label": "bed", **CAMERAS, **BED, "confidence_robot": 0.8}, CONFIG, "contradicted", False),
        ({"label": "bed", **CAMERAS, **BED, "confidence_robot": 0.1}, CONFIG, "open", False),
        # one view of the robot against several of cameras
        ({"status": "confirmed", **CAMERAS, **BED, "confidence_robot": 0.8}, CONFIG, "open", True),
    ],
)
def test_verdict(make_record, facts, config, expected, enough):
    record = make_record(**facts)
    assert verify(record, "chair", config) == expected
    assert is_likely_enough(record, "chair", config) == enough


def test_standoff_is_near_and_not_behind_a_wall(make_record):
    """A chair right behind a wall: nobody stands on this side of it; without the wall somebody may."""
    occupancy = np.zeros(GRID.shape, np.uint8)
    occupancy[100:103, 20:180] = 1  # y = 5.00 .. 5.15, with ways round both ends
    chair = make_record(at=(5.0, 5.45), size=(0.5, 0.5))
    for walls, below in ((occupancy, False), (np.zeros_like(occupancy), True)):
        m = maps(occupancy=walls)
        terrain = build_terrain(m, HERE, MissionState("chair"), CONFIG)
        place = goal_region(terrain, coarse_travel_time_m(terrain, HERE.x_m, HERE.y_m), chair, HERE, CONFIG)
        assert place is not None
        assert place.distance_m[place.goals].max() <= CONFIG.standoff_m + 1e-6
        ys = terrain.grid.centres_of(np.argwhere(place.goals))[:, 1]
        assert (ys < 5.0).any() == below


def test_no_standoff_in_a_closed_room(make_record):
    occupancy = np.zeros(GRID.shape, np.uint8)
    occupancy[100:103, :] = 1
    m = maps(occupancy=occupancy)
    terrain = build_terrain(m, HERE, MissionState("chair"), CONFIG)
    travel_time_m = coarse_travel_time_m(terrain, HERE.x_m, HERE.y_m)
    assert goal_region(terrain, travel_time_m, make_record(at=(5.0, 8.0)), HERE, CONFIG) is None


@pytest.mark.parametrize("seed", range(12))
def test_a_goal_region_is_the_same_looked_for_nearby_or_everywhere(make_record, monkeypatch, seed):
    """Only the surroundings of an object are looked at: that is an optimisation and changes nothing."""
    rng = np.random.default_rng(seed)
    occupancy = np.zeros(GRID.shape, np.uint8)
    for row, col in rng.integers(0, 190, size=(25, 2)):
        occupancy[row : row + rng.integers(2, 12), col : col + rng.integers(2, 40)] = 1
    m = maps(occupancy=occupancy)
    terrain = build_terrain(m, HERE, MissionState("chair"), CONFIG)
    travel_time_m = coarse_travel_time_m(terrain, HERE.x_m, HERE.y_m)
    x, y = rng.uniform(0.0, 10.0, size=2)  # at the map's edge, too
    points = rng.normal((x, y, 1.0), (0.4, 0.2, 0.2), size=(60, 3)).astype(np.float32)
    low = rng.integers(2) == 0
    thing = make_record(
        center_m=(x, y, 0.5 if low else 1.0), size_m=(0.8, 0.4, 0.8), seen_from=(0.0, 0.8), points=points.tobytes()
    )
    nearby = goal_region(terrain, travel_time_m, thing, HERE, CONFIG)
    whole = regions._Window(terrain, 0, 0, terrain.grid.shape)
    monkeypatch.setattr(regions._Window, "around", classmethod(lambda cls, terrain, cells, margin_m: whole))
    everywhere = goal_region(terrain, travel_time_m, thing, HERE, CONFIG)
    assert (nearby is None) == (everywhere is None)
    if nearby is not None:
        assert np.array_equal(nearby.goals, everywhere.goals)
        assert np.array_equal(nearby.sight, everywhere.sight)
        assert nearby.nearest_m == everywhere.nearest_m
        asked = everywhere.distance_m <= CONFIG.inspect_m
        assert np.array_equal(nearby.distance_m[asked], everywhere.distance_m[asked])
        assert (nearby.distance_m[~asked] > CONFIG.inspect_m).all()


def standing(make_record, occupancy, **facts):
    """Where to stand before a small thing in the middle of the map, and the terrain."""
    terrain = build_terrain(maps(occupancy=occupancy), HERE, MissionState("chair"), CONFIG)
    thing = make_record(at=(5.0, 5.0), size=(0.3, 0.3), **facts)
    return terrain, goal_region(terrain, coarse_travel_time_m(terrain, HERE.x_m, HERE.y_m), thing, HERE, CONFIG)


def test_a_thing_on_a_table_is_looked_at_over_the_table_and_not_over_a_wall(make_record):
    """A table of 1.2 m with a plant on it; south of it, where the robot comes from, with and without a wall."""
    table = np.zeros(GRID.shape, np.uint8)
    table[88:112, 88:112] = 1
    walled = table.copy()
    walled[82:84, 20:180] = 1  # 20 cm south of the table
    high = {"center_m": (5.0, 5.0, 0.95), "size_m": (0.3, 0.3, 0.4)}
    for occupancy, south in ((table, True), (walled, False)):
        terrain, place = standing(make_record, occupancy, **high)
        assert place.distance_m[place.goals].max() <= 0.85 + 1e-6
        assert terrain.speed[place.goals].min() > CONFIG.constrained_speed
        ys = terrain.grid.centres_of(np.argwhere(place.goals))[:, 1]
        assert (ys < 4.3).any() == south
    terrain, place = standing(make_record, table)  # as high as the table's legs: it is under the table
    assert not place.sight[place.goals].any()


@pytest.mark.parametrize(
    ("seen_from", "south", "north"),
    [((0.0, 1.0), False, True), ((0.1, -0.9), True, False), ((0.2, 0.3), True, True), ((0.0, 0.0), True, True)],
)
def test_what_hangs_on_a_wall_over_a_sideboard_is_gone_to_from_the_side_it_was_seen_from(
    make_record, seen_from, south, north
):
    """A map doesn't tell a wall from the sideboards on both of its sides: those who saw the thing do."""
    thick = np.zeros(GRID.shape, np.uint8)
    thick[94:106, 60:140] = 1  # y = 4.70 .. 5.30
    high = {"center_m": (5.0, 5.0, 1.4), "size_m": (0.3, 0.3, 0.6), "seen_from": seen_from}
    terrain, place = standing(make_record, thick, **high)
    ys = terrain.grid.centres_of(np.argwhere(place.sight))[:, 1]
    assert ((ys < 4.7).any(), (ys > 5.3).any()) == (south, north)
    stood = terrain.grid.centres_of(np.argwhere(place.goals))[:, 1]
    assert (stood < 4.7).any() == south


def test_a_little_farther_off_will_do_where_the_way_nearer_leads_round(make_record):
    """South of the thing a low wall, 70 cm off, 8 m long: nearer places are only on its other side."""
    wall = np.zeros(GRID.shape, np.uint8)
    wall[82:83, 20:180] = 1
    stool = {"center_m": (5.0, 5.0, 0.2), "size_m": (0.3, 0.3, 0.4)}
    for cells, nearest_m in ((wall, 0.95), (np.zeros_like(wall), CONFIG.standoff_m)):
        raised = {**stool, "center_m": (5.0, 5.0, 0.8), "seen_from": (0.0, -0.9)}
        _, place = standing(make_record, cells, **raised)
        assert place.nearest_m == pytest.approx(nearest_m)


def test_nobody_stands_in_a_gap_that_is_too_tight_by_the_map(make_record):
    """Two cupboards 30 cm apart with a thing behind: the gap's cells are nearer, but a robot most likely gets stuck."""
    occupancy = np.zeros(GRID.shape, np.uint8)
    occupancy[90:100, 60:97] = occupancy[90:100, 103:140] = 1
    terrain, place = standing(make_record, occupancy)
    assert terrain.speed[place.goals].min() > CONFIG.constrained_speed


@pytest.mark.parametrize("score", [-1e6, math.nan, math.inf, 1.5])
def test_scores_that_are_none_say_nothing(make_record, score):
    record = make_record(label="bed", label_robot="chair", label_scores={"chair": score}, seen_from=(math.nan, score))
    assert chance(record, "chair") == chance(msgspec.structs.replace(record, label_scores={}), "chair")


def test_a_chance_is_what_the_map_says_for_any_word(make_record):
    for label, facts in itertools.product(("bed", "chair", "dragon"), ({"n_detections": 1}, {"status": "confirmed"})):
        record = make_record(label=label, confidence=0.42, label_scores={label: 0.42, "tv": 0.1}, **facts)
        assert (chance(record, label), chance(record, "tv")) == (0.42, 0.1)


@pytest.mark.parametrize(
    ("confidence", "far_m", "first"),
    [(0.45, 4.0, "far"), (0.3, 30.0, "frontier"), (0.6, 4.0, "far"), (0.26, 15.0, "frontier")],
)
def test_exploring_near_by_may_be_worth_more_than_a_faint_candidate_far_away(make_record, confidence, far_m, first):
    """A frontier 1 m ahead, a candidate seen once."""
    grid = Grid(0.0, 0.0, 0.05, 60, 700)
    frontier = np.zeros(grid.shape, np.uint8)
    frontier[10:30, 40] = 1
    nothing, explored = np.zeros(grid.shape, np.uint8), np.ones(grid.shape, np.uint8)
    candidate = make_record(at=(1.0 + far_m, 1.0), confidence=confidence)
    m = FloorMaps("0", 0.0, grid, nothing, explored, frontier, np.full(grid.shape, np.nan, np.float32), [candidate], 1)
    state = MissionState("chair", floor="0")
    state.here.scan_turns_left = 0
    here = RobotView(1, 1.0, 1.0, 0.0, 0.0, "0", False, None, 0.0)
    assert step(state, m, here, CONFIG)[1].phase == ("approaching" if first == "far" else "exploring")
    assert step(state, m, here, CONFIG.changed(explore_chance=1.0))[1].phase == "exploring"
    assert step(state, m, here, CONFIG.changed(choice="paper"))[1].phase == "approaching"


class Routes:
    """A planner whose ways have these lengths, one a step."""

    def __init__(self, lengths_m):
        self.lengths_m = iter(lengths_m)

    def route(self, terrain, goals, robot, config):
        return Route("move_forward", ((robot.x_m, robot.y_m),), next(self.lengths_m))


@pytest.mark.parametrize(("detours", "kept"), [(1, True), (CONFIG.max_detours, True), (CONFIG.max_detours + 1, False)])
def test_a_way_that_turns_out_longer_gets_new_patience_but_not_for_ever(detours, kept):
    """Every 15 steps, in which nothing is gained on the best so far, the map shows that the way is 10 m longer."""
    n = CONFIG.patience_steps * 3 // 4
    lengths_m = [5.0 + 10.0 * k + 0.01 * i for k in range(detours + 1) for i in range(n)]
    m = maps([(100, c) for c in range(90, 110)])
    state = MissionState("chair")
    context = StepContext.from_inputs(state, m, HERE, CONFIG, Routes(lengths_m), {}, by_chance_per_metre)
    state.commit_to(Candidate("frontier", 5.0, 5.0, 0.0, True, ""), CONFIG)
    gone = []
    for _ in lengths_m:
        if follow_route(context, context.terrain.disc(5.0, 5.0, 0.3)) is None:
            gone.append(state.step)
            break
        state.step += 1
    assert (not gone) == kept


def objects_of(context):
    return [option.record for option in confirmed_objects(context) + promising_candidates(context)]


def context_with(record, state):
    return StepContext.from_inputs(state, maps(objects=[record]), HERE, CONFIG, Routes([]), {}, by_chance_per_metre)


@pytest.mark.parametrize(("share", "kept"), [(0.5, False), (0.9, True), (1.5, True)])
def test_the_way_to_the_stairs_is_left_only_for_what_is_clearly_worth_more(make_record, share, kept):
    """``share``: what the way to the stairs is worth of what the candidate is."""
    candidate = make_record(at=(5.0, 5.0), confidence=0.3, n_detections=3)
    alone = choose(context_with(candidate, MissionState("chair"))).chosen
    state = MissionState("chair", floor="0", floor_goal=FloorGoal("1", "cameras", share * alone.utility))
    state.here.is_searched = True
    stairs = Stair(floor="0", at_m=(9.0, 9.0, 0.0), to_floor="1", to_m=(9.0, 9.0, 3.0), length_m=4.0)
    context = replace(context_with(candidate, state), robot=replace(HERE, stairs=(stairs,)))
    assert choose(context).chosen.record is candidate  # not on the way yet
    state.waypoint = CurrentWaypoint("stairs", 9.0, 9.0, None, 0)
    assert (choose(context).chosen.kind == "stairs") == kept


@pytest.mark.parametrize(("status", "tries"), [("candidate", 2), ("confirmed", 4)])
def test_a_confirmed_target_is_tried_again_more_often(make_record, status, tries):
    record = make_record(at=(5.0, 5.0), status=status, confidence=0.6, n_detections=3)
    state = MissionState("chair")
    for n in range(1, tries + 1):
        state.blacklist_place(5.0, 5.0, CONFIG)
        assert objects_of(context_with(record, state)) == []  # for now
        state.step += CONFIG.blacklist_steps
        assert objects_of(context_with(record, state)) == [record] * (n < tries)


def test_the_floor_at_its_foot_is_no_part_of_an_object(make_record):
    """A mask that takes in a strip of floor before a couch: only of what is all floor it is all there is."""
    couch = [(2.0 + 0.02 * i, 3.0, z) for i in range(40) for z in (0.3, 0.6)]
    strip = [(2.0 + 0.02 * i, 2.4, 0.03) for i in range(40)]

    def lowest_y(points, floor_z_m):
        raw = np.array(points, np.float32)
        raw[:, 2] += floor_z_m
        record = msgspec.structs.replace(make_record(), points=raw.tobytes())
        return footprint(record, floor_z_m)[:, 1].min()

    for floor_z_m in (0.0, 5.2):
        assert lowest_y(couch + strip, floor_z_m) == pytest.approx(3.0)
        assert lowest_y(strip, floor_z_m) == pytest.approx(2.4)


@pytest.mark.parametrize(("steps_left", "goes"), [(200, False), (15, True)])
def test_the_best_of_what_was_dismissed_is_taken_when_the_steps_run_out(make_record, steps_left, goes):
    """A chair that the robot was half sure of, 1 m away, and a whole building to explore."""
    seen = make_record(at=(6.0, 1.0), label_robot="chair", confidence_robot=0.35, confidence=0.35, n_detections=6)
    state = MissionState("chair", step=500 - steps_left, floor="0")
    state.here.scan_turns_left = 0
    state.here.dismissed[seen.id] = DismissedObject(6.0, 1.0, "not sure")
    m = maps([(60, c) for c in range(90, 110)], objects=[seen])
    after, decision = step(state, m, HERE, CONFIG)
    assert (after.here.accepted_object == seen.id) == goes
    assert (decision.object_id == seen.id) == goes


@pytest.mark.parametrize(
    ("status", "dismissed", "label_robot", "may_be"),
    [
        ("candidate", False, "", True),
        ("candidate", False, "bed", True),
        ("rejected", False, "chair", True),
        ("rejected", True, "chair", True),
        ("rejected", False, "", False),
        ("candidate", True, "", False),
        ("candidate", True, "bed", False),
        ("confirmed", False, "chair", True),
    ],
)
def test_what_may_be_a_last_resort(make_record, status, dismissed, label_robot, may_be):
    """What nobody judged, or what the robot itself takes for the target though it was judged."""
    record = make_record(at=(6.0, 1.0), confidence=0.5, label_robot=label_robot, status=status, n_detections=6)
    state = MissionState("chair", floor="0")
    if dismissed:
        state.here.dismissed[record.id] = DismissedObject(6.0, 1.0, "not confirmed")
    assert objects.last_resorts([record], state, CONFIG) == [record] * may_be
    under_a_new_id = msgspec.structs.replace(record, id=77)
    if status != "confirmed":
        assert objects.last_resorts([under_a_new_id], state, CONFIG) == [under_a_new_id] * may_be
    surely_a_bed = msgspec.structs.replace(record, label="bed", status="confirmed")
    assert objects.last_resorts([surely_a_bed], state, CONFIG) == []


@pytest.mark.parametrize("status", ["candidate", "confirmed"])
def test_less_than_the_chance_asked_for_is_no_last_resort(make_record, status):
    record = make_record(at=(6.0, 1.0), confidence=0.3, n_detections=6, status=status)
    sure = chance(record, "chair")
    for asked, may_be in ((sure - 0.01, True), (sure + 0.01, False)):
        config = CONFIG.changed(last_resort_chance=asked)
        assert objects.last_resorts([record], MissionState("chair"), config) == [record] * may_be
    never = CONFIG.changed(last_resort_chance=None)
    assert objects.last_resorts([record], MissionState("chair"), never) == []


def test_the_likeliest_that_a_way_leads_to_is_the_last_resort(make_record):
    """The best stands in a closed room; the next was dismissed, and oscillated; the third is less likely."""
    walls = np.zeros(GRID.shape, np.uint8)
    walls[100:161, 100] = walls[100:161, 160] = walls[100, 100:161] = walls[160, 100:161] = 1
    walled = make_record(id=1, at=(6.5, 6.5), confidence=0.9, n_detections=6)
    second = make_record(id=2, at=(7.0, 1.0), confidence=0.5, label_robot="chair", n_detections=6)
    third = make_record(id=3, at=(6.0, 1.0), confidence=0.4, n_detections=6)
    state = MissionState("chair", floor="0")
    state.here.dismissed[2], state.here.oscillations[2] = DismissedObject(7.0, 1.0, "not confirmed"), 5
    state.blacklist_place(7.0, 1.0, CONFIG)
    m = maps(objects=[walled, second, third], occupancy=walls)
    context = StepContext.from_inputs(state, m, HERE, CONFIG, Routes([]), {}, by_chance_per_metre)

    def accept():
        """What is accepted now; None: nothing new."""
        options = last_resort(context)
        if options:
            state.apply(Choice(options[0], tuple(options)), CONFIG)
        return state.here.accepted_object if options else None

    assert objects.last_resorts(m.objects, state, CONFIG)[0] is walled
    assert accept() == 2
    assert choose(context).chosen.record is second, "neither the blacklist nor oscillating holds it back"
    assert accept() is None, "no news"
    for _ in range(2):
        state.blacklist_place(7.0, 1.0, CONFIG)
    assert accept() == 3, "what was given up for good makes room for the next"
    m.objects.remove(third)
    context = context.anew(state)
    assert accept() is None, "it was merged into another"
    assert accepted_object(context) == []


def test_what_the_map_says_is_worked_out_once_a_step(make_record, monkeypatch):
    """A confirmed target that no way leads to is tried four times within a step; nothing about the map is asked anew."""
    walls = np.zeros(GRID.shape, np.uint8)
    walls[100:161, 100:161] = 1
    m = maps(objects=[make_record(at=(6.5, 6.5), status="confirmed")], occupancy=walls)
    asked = Counter()

    def counted(name):
        ask = getattr(reach, name)
        monkeypatch.setattr(reach, name, lambda *args: asked.update([name]) or ask(*args))

    for name in ("find_frontiers", "goal_region", "coarse_travel_time_m"):
        counted(name)
    state = MissionState("chair", floor="0", floors={"0": FloorMemory(scan_turns_left=0, is_searched=True)})
    after, _ = step(state, m, HERE, CONFIG)
    assert [entry.failures for entry in after.here.blacklist.entries] == [4]
    assert asked == {"find_frontiers": 1, "goal_region": 1, "coarse_travel_time_m": 1}


@pytest.mark.parametrize("judged_before", [False, True])
def test_a_last_resort_is_judged_once(make_record, judged_before):
    """Nobody had looked at it, and it is a bed: dismissed. It was dismissed before: views that disagree decide nothing."""
    record = make_record(at=(6.0, 1.0), label="bed", confidence=0.6, label_robot="bed", confidence_robot=0.6)
    record = msgspec.structs.replace(record, label_scores={"bed": 0.6, "chair": 0.3})
    state = MissionState("chair", floor="0")
    state.here.accepted_object = record.id
    if judged_before:
        state.here.dismissed[record.id] = DismissedObject(6.0, 1.0, "not confirmed")
    context = context_with(record, state)
    choice = choose(context)
    assert choice.chosen.is_accepted
    state.apply(choice, CONFIG)
    assert (approach_object(context, choice.chosen) is None) is not judged_before
    assert state.here.accepted_object == (record.id if judged_before else None)
    assert record.id in state.here.dismissed
    assert last_resort(context) == []


def test_the_last_resort_may_stand_where_nobody_has_looked(make_record):
    """A rejected object 3 m beyond all that is explored, and the steps run out."""
    seen = make_record(at=(9.0, 1.0), label_robot="chair", confidence=0.5, n_detections=6, status="rejected")
    explored = np.zeros(GRID.shape, np.uint8)
    explored[:60, :120] = 1
    m = replace(maps([(30, c) for c in range(90, 110)], objects=[seen]), explored=explored)
    state = MissionState("chair", step=450, floor="0")
    state.here.scan_turns_left = 0
    after, decision = step(state, m, HERE, CONFIG)
    assert (after.here.accepted_object, decision.object_id) == (seen.id, seen.id)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"label": "tv", "confidence": 0.45}, "tv 15 (confidence 0.45)"),
        (
            {"label": "tv stand", "confidence": 0.45, "label_scores": {"tv stand": 0.45, "tv": 0.41}},
            "tv stand 15 (tv by 0.41)",
        ),
    ],
)
def test_an_object_of_another_name_is_said_with_the_chance_that_sends_the_robot_there(make_record, facts, said):
    context = SimpleNamespace(state=SimpleNamespace(target="tv"))
    assert _describe(context, make_record(id=15, **facts)) == said


@pytest.mark.parametrize(("max_look_places", "n_places"), [(1, 1), (2, 2)])
def test_what_only_cameras_saw_is_looked_at_from_several_places(world, thing, max_look_places, n_places):
    """The robot may have stood where it can't see the object: it goes to another place before it believes the cameras."""
    w = world(HALL, {"C": thing("chair", known={"label": "chair", "confidence": 0.97})})
    looked_from = []

    def watch(maps, robot, state, decision):
        if "again, 1 of" in decision.message:
            looked_from.append((robot.x_m, robot.y_m))

    _, last = w.run(max_steps=120, watch=watch, config=CONFIG.changed(max_look_places=max_look_places))
    assert last.found
    assert len(looked_from) == n_places
    assert all(math.dist(a, b) >= 0.4 for a, b in itertools.combinations(looked_from, 2))


def test_what_the_robot_saw_itself_needs_no_second_place(make_record, world, thing):
    w = world(HALL, {"C": thing("chair", looks_like="chair", known={"label": "chair", "confidence": 0.97})})
    w.run(
        max_steps=120, watch=lambda m, r, state, d: state.here.looked_from and pytest.fail(str(state.here.looked_from))
    )
