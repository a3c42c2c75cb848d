"""A sense of place: the features of frontiers, and how the model's chances rate them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Grid
from surveilnav.services.planner.core import FloorMaps, MissionState, PlannerConfig
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.options.frontiers import rule_of
from surveilnav.services.planner.core.places.features import GEOMETRY, OBJECTS, FrontierFeatures, names, of_target
from surveilnav.services.planner.core.places.model import shipped
from surveilnav.services.planner.core.places.rule import by_places, expected_way_m

LABELS = ("bed", "chair")
#: A room of 6 x 4 m with a door to the right, beyond which nothing is known; a metre is five coarse cells.
ROOM = """
##############################
#............................#
#............................#
#............................#
#............................#
#............................#
#............................#
#.............................
#.............................
#.............................
#.............................
#............................#
#............................#
#............................#
#............................#
#............................#
#............................#
##############################
"""
PER_M, MARGIN = 20, 4.0


def floor_of(text: str, objects=()) -> FloorMaps:
    """A map at 0.05 m of a drawing at 0.2 m, with 4 m of the unknown around it; the drawing's lower left corner is at (0, 0)."""
    rows = text.strip().splitlines()[::-1]
    drawn = np.array([list(r.ljust(max(map(len, rows)))) for r in rows]).repeat(4, axis=0).repeat(4, axis=1)
    drawn = np.pad(drawn, round(MARGIN * PER_M), constant_values=" ")
    grid = Grid(-MARGIN, -MARGIN, 0.05, *drawn.shape)
    explored = (drawn != " ").astype(np.uint8)
    nothing = np.zeros(drawn.shape, np.uint8)
    values = np.full(drawn.shape, np.nan, np.float32)
    return FloorMaps("0", 0.0, grid, (drawn == "#").astype(np.uint8), explored, nothing, values, list(objects), 1)


def features_at(x_m, y_m, text=ROOM, objects=(), **more):
    """By name: the features of a frontier at a place."""
    frontier = Frontier(x_m, y_m, 20, 3.0, **more)
    row = FrontierFeatures(floor_of(text, objects), (1.0, 1.7), LABELS).of([frontier])[0]
    of_objects = [f"{kind} {label}" for kind in OBJECTS for label in LABELS]
    return dict(zip([*GEOMETRY, *of_objects], row.tolist(), strict=True))


def test_a_door_leads_into_the_unknown_and_a_wall_does_not():
    door, corner = features_at(5.9, 1.8), features_at(0.5, 0.5)
    assert door["unknown_ahead_mean_m"] > 7.0
    assert corner["unknown_mean_m"] < 0.5
    assert door["unknown_within_3_m"] > corner["unknown_within_1.5_m"]
    assert door["free_behind_max_m"] == pytest.approx(5.6, abs=0.4)
    assert door["to_edge_m"] < 0.3


def test_shares_of_a_square_add_up_to_one():
    f = features_at(5.9, 1.8)
    assert f["unknown_within_1.5_m"] + f["free_within_1.5_m"] + f["occupied_within_1.5_m"] == pytest.approx(1.0)


def test_what_is_explored_and_reached_is_the_room():
    f = features_at(5.9, 1.8)
    assert f["explored_m2"] == pytest.approx(28 * 16 * 0.04, rel=0.03)
    assert f["reached_m2"] == pytest.approx(f["explored_m2"], rel=0.05)
    assert features_at(5.9, 1.8, ROOM.replace("#......", "#.....#"))["reached_m2"] < f["reached_m2"]


def test_objects_count_less_with_distance_and_behind_walls(make_record):
    def bed(x_m, text=ROOM):
        record = make_record(id=1, at=(x_m, 1.7), label_scores={"bed": 0.8})
        return features_at(5.9, 1.8, text, [record])

    near, far = bed(4.9), bed(1.9)
    assert near["near_2_m bed"] == pytest.approx(0.8 * np.exp(-1.0 / 2.0), rel=0.02)
    assert far["near_5_m bed"] == pytest.approx(0.8 * np.exp(-4.0 / 5.0), rel=0.02)
    assert near["through bed"] > far["through bed"] > 0.0
    assert near["near_2_m chair"] == 0.0
    walled = bed(1.9, "\n".join(line[:15] + "#" + line[16:] for line in ROOM.strip().splitlines()))
    assert walled["through bed"] == 0.0
    assert walled["near_5_m bed"] == far["near_5_m bed"]


def test_rejected_objects_say_nothing(make_record):
    record = make_record(id=1, at=(4.9, 1.7), label_scores={"bed": 0.8}, status="rejected")
    assert features_at(5.9, 1.8, objects=[record])["near_5_m bed"] == 0.0


def test_a_map_that_is_moved_has_the_same_features():
    """Frames: nothing depends on where the world's origin is."""
    maps, at = floor_of(ROOM), (5.9, 1.8)
    moved = replace(
        maps, grid=replace(maps.grid, origin_x_m=maps.grid.origin_x_m + 12.4, origin_y_m=maps.grid.origin_y_m - 7.2)
    )
    here = FrontierFeatures(maps, (1.0, 1.7), LABELS).of([Frontier(*at, 20, 3.0)])
    there = FrontierFeatures(moved, (13.4, -5.5), LABELS).of([Frontier(at[0] + 12.4, at[1] - 7.2, 20, 3.0)])
    assert there == pytest.approx(here, abs=1e-4)


def test_the_targets_own_columns_are_those_of_its_label():
    features = np.arange(2 * (len(GEOMETRY) + 6), dtype=np.float32).reshape(2, -1)
    rows = of_target(features, LABELS, ("chair", "tv"), "chair", 0.4)
    by_name = dict(zip(names(LABELS, ("chair", "tv")), rows[1].tolist(), strict=True))
    assert len(by_name) == rows.shape[1]
    for kind in OBJECTS:
        assert by_name[f"{kind} target"] == by_name[f"{kind} chair"]
    assert (by_name["chair"], by_name["tv"], by_name["target chance"]) == (1.0, 0.0, pytest.approx(0.4))


ascending = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).map(sorted)


@given(ascending)
def test_the_expected_way_is_that_of_many_draws(chances):
    """Against draws of where the target lies, as likely anywhere between two distances."""
    within_m = np.array([2.0, 5.0, 12.0])
    u = (np.arange(4000) + 0.5) / 4000
    k = np.searchsorted(chances, u, side="right")
    low, high = np.array([0.0, *within_m])[k], np.array([*within_m, 24.0])[k]
    below, above = np.array([0.0, *chances])[k], np.array([*chances, 1.0])[k]
    lies_m = low + (high - low) * (u - below) / np.maximum(above - below, 1e-12)
    assert expected_way_m(np.array([chances]), within_m)[0] == pytest.approx(lies_m.mean(), abs=0.05)


def test_a_search_by_places_explores_what_is_likely(world):
    """The whole step: chances are shown, utilities are chance per metre, and asking again says the same."""
    w = world(ROOM_PLAN)
    config = PlannerConfig(strategy="places")
    state = MissionState("chair", floor="0")
    context = StepContext.from_inputs(state, w.maps(), w.robot(), config, FmmPlanner(), {}, rule_of(config))
    rated = context.rule(context, context.reach.frontiers)
    assert rated
    assert rated == context.rule(context, context.reach.frontiers)
    for r in rated:
        assert r.chance == config.places_certainty
        assert r.cost_m > r.frontier.travel_time_m
        assert r.utility == pytest.approx(r.chance / r.cost_m)
        assert "beyond" in r.why


ROOM_PLAN = """
##########################################
#                   #                    #
#   R                                    #
#                   #                    #
##########################################
"""


def test_a_word_that_the_model_does_not_know_is_expected_wherever_anything_is():
    model, maps = shipped(), floor_of(ROOM)
    found = [Frontier(5.9, 1.8, 20, 3.0), Frontier(3.0, 1.0, 5, 2.0)]
    known = [model.chances(maps, (1.0, 1.7), found, target) for target in model.targets]
    assert model.chances(maps, (1.0, 1.7), found, "bagpipes") == pytest.approx(np.mean(known, axis=0), abs=1e-6)
    assert (np.diff(known[0], axis=1) >= 0.0).all()
    assert model.chances(maps, (1.0, 1.7), [], "chair").shape == (0, len(model.within_m))


@pytest.mark.parametrize(("hidden_m2", "share"), [(math.nan, 1.0), (0.0, 0.5), (1000.0, 1.0)])
def test_what_a_map_from_before_knows_to_be_hidden_counts(world, hidden_m2, share):
    w, config = world(ROOM_PLAN), PlannerConfig()
    state = MissionState("chair", floor="0")
    context = StepContext.from_inputs(state, w.maps(), w.robot(), config, FmmPlanner(), {}, rule_of(config))
    found = [replace(f, hidden_m2=hidden_m2) for f in context.reach.frontiers]
    assert {r.chance for r in by_places(context, found)} == {config.places_certainty * share}
