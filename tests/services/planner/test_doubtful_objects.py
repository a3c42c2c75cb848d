"""Objects that the robot looked at and that may be the target all the same."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from surveilnav.geometry import Grid
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView
from surveilnav.services.planner.core.behaviours.approach_object import (
    _Approach,
    _look_from_elsewhere,
    _region_elsewhere,
)
from surveilnav.services.planner.core.choice import choose
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.objects import candidates
from surveilnav.services.planner.core.memory.floor_memory import DismissedObject
from surveilnav.services.planner.core.memory.mission_state import CurrentWaypoint
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.options.candidates import object_option
from surveilnav.services.planner.core.options.doubtful_objects import doubtful_objects
from surveilnav.services.planner.core.options.frontiers import by_chance_per_metre

TWICE = PlannerConfig(max_look_places=2)
GRID = Grid(0.0, 0.0, 0.05, 200, 200)
HERE = RobotView(0, 5.0, 1.0, 0.0, 0.0, "0", False, None, 0.0)
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


def dismissed_before(record, *, looked_from=((4.0, 1.0),)):
    """A mission that dismissed an object on a floor where all else is explored."""
    here = FloorMemory(scan_turns_left=0, scan_places=[(5.0, 1.0)])
    here.dismissed[record.id] = DismissedObject(*record.center_m[:2], "not confirmed")
    here.looked_from[record.id] = list(looked_from)
    return MissionState("chair", floor="0", floors={"0": here})


def context_of(record, state, config=TWICE, robot=HERE, occupancy=None):
    explored = np.ones(GRID.shape, np.uint8)
    nothing = np.zeros(GRID.shape, np.uint8)
    value = np.full(GRID.shape, np.nan, np.float32)
    maps = FloorMaps("0", 0.0, GRID, nothing if occupancy is None else occupancy, explored, nothing, value, [record], 1)
    return StepContext.from_inputs(state, maps, robot, config, FmmPlanner(), {}, by_chance_per_metre)


@pytest.mark.parametrize(
    ("likelihood", "by_robot", "status", "comes_back"),
    [
        (0.80, "chair", "candidate", True),
        (0.80, "chair", "confirmed", True),
        (0.60, "chair", "candidate", False),  # not enough to stop there
        (0.80, "couch", "candidate", False),  # the robot sees something else
        (0.80, "", "confirmed", False),  # only cameras say so
        (0.80, "chair", "rejected", False),
    ],
)
def test_a_dismissed_object_comes_back_once_the_robot_sees_it_well(
    make_record, likelihood, by_robot, status, comes_back
):
    facts = {"confidence": likelihood, "label_robot": by_robot, "confidence_robot": likelihood, "status": status}
    record = make_record(at=(6.0, 1.0), **facts)
    assert candidates([record], dismissed_before(record), TWICE) == ([record] if comes_back else [])


@pytest.mark.parametrize(
    ("likelihood", "status", "n_places", "max_look_places", "is_proposed"),
    [
        (0.4, "candidate", 1, 2, True),
        (0.4, "candidate", 1, 1, False),
        (0.4, "candidate", 2, 2, False),
        (0.4, "candidate", 2, 3, True),
        (0.4, "rejected", 1, 2, False),
        (0.09, "candidate", 1, 2, False),  # less than promising_chance
    ],
)
def test_a_doubtful_object_is_looked_at_from_so_many_places(
    make_record, likelihood, status, n_places, max_look_places, is_proposed
):
    record = make_record(at=(6.0, 1.0), confidence=likelihood, status=status)
    state = dismissed_before(record, looked_from=[(4.0, 1.0), (6.0, 3.0)][:n_places])
    context = context_of(record, state, TWICE.changed(max_look_places=max_look_places))
    assert [o.record for o in doubtful_objects(context)] == ([record] if is_proposed else [])


def test_it_is_looked_at_before_looking_around_once_more(make_record):
    """What contradicted it from the first place doesn't keep the robot from going to the second."""
    record = make_record(at=(8.0, 1.0), label="couch", confidence=0.5, label_robot="couch", confidence_robot=0.5)
    record = msgspec.structs.replace(record, label_scores={"couch": 0.5, "chair": 0.3})
    state = dismissed_before(record)
    choice = choose(context_of(record, state))
    assert (choice.chosen.kind, choice.chosen.record) == ("candidate", record)
    untouched = choose(context_of(record, dismissed_before(record), PlannerConfig(max_look_places=1)))
    assert untouched.chosen.kind == "second_look"


@pytest.mark.parametrize(("max_look_places", "n_places"), [(1, 1), (2, 2), (3, 3)])
def test_what_the_robot_sees_vaguely_is_looked_at_from_several_places(world, thing, max_look_places, n_places):
    """The robot sees a chair with 0.45 wherever it stands: too little to stop at, too much to go away. In the end it is taken."""
    w = world(HALL, {"C": thing("chair", known={"label": "chair", "confidence": 0.45})})
    exact, looked_from, phases = w.objects, [], []

    def vague():
        facts = {"label_robot": "chair", "confidence_robot": 0.45, "confidence": 0.45, "status": "candidate"}
        return [msgspec.structs.replace(o, **facts) for o in exact()]

    def watch(maps, robot, state, decision):
        phases.append(decision.phase)
        if "again, 1 of" in decision.message and "second look" not in phases:
            looked_from.append((robot.x_m, robot.y_m))

    w.objects = vague
    _, last = w.run(watch=watch, config=PlannerConfig(max_look_places=max_look_places))
    assert last.found
    assert len(looked_from) == n_places
    assert all(math.dist(a, b) >= 0.4 for a, b in itertools.combinations(looked_from, 2))


def looked_in_vain(make_record, *, length_m=1.0, config=TWICE):
    """An approach that saw nothing of an object that closes the north end of a corridor ``length_m`` long. Its other side is
    reached round the corridor's walls only."""
    record = make_record(at=(5.0, 6.0), size=(0.7, 0.4), confidence=0.4)
    walls = np.zeros(GRID.shape, np.uint8)
    for x_m in (4.65, 5.35):
        walls[GRID.cells_of((x_m, 6.2 - length_m))[0] : GRID.cells_of((x_m, 6.2))[0], GRID.cells_of((x_m, 1.0))[1]] = 1
    walls[GRID.cells_of((5.0, 6.0))[0], GRID.cells_of((4.65, 6.0))[1] : GRID.cells_of((5.35, 6.0))[1]] = 1
    heading = CurrentWaypoint("candidate", 5.0, 6.0, None, 0, object_id=record.id)
    state = MissionState("chair", floor="0", floors={"0": FloorMemory()}, waypoint=heading)
    context = context_of(record, state, config, robot=replace(HERE, y_m=5.2), occupancy=walls)
    return _Approach(context, record, object_option(context, record), "open")


@pytest.mark.parametrize(("length_m", "goes"), [(1.0, True), (5.0, False)])
def test_a_place_with_a_long_way_round_is_left_for_later(make_record, length_m, goes):
    approach = looked_in_vain(make_record, length_m=length_m)
    assert (_look_from_elsewhere(approach) is not None) == goes
    assert len(approach.context.state.here.looked_from.get(approach.record.id, ())) == goes


@pytest.mark.parametrize("length_m", [1.0, 5.0])
def test_who_went_to_another_place_keeps_going_there(make_record, length_m):
    """However long the way is from where it is now."""
    approach = looked_in_vain(make_record, length_m=length_m)
    approach.context.state.here.record_looked_from(approach.record.id, 5.0, 5.2)
    assert _region_elsewhere(approach.context, approach.record) is not None


def test_the_last_resort_is_taken_from_where_the_way_is_shortest(make_record):
    approach = looked_in_vain(make_record)
    approach.context.state.here.accepted_object = approach.record.id
    assert _look_from_elsewhere(approach) is None
    approach.context.state.here.record_looked_from(approach.record.id, 5.0, 5.2)
    assert _region_elsewhere(approach.context, approach.record) is None


def test_the_papers_verification_knows_no_other_places(make_record):
    approach = looked_in_vain(make_record, config=TWICE.changed(verification="paper"))
    assert _look_from_elsewhere(approach) is None
    approach.context.state.here.record_looked_from(approach.record.id, 5.0, 5.2)
    assert _region_elsewhere(approach.context, approach.record) is None


@pytest.mark.parametrize(("n_looks", "comes_back"), [(2, True), (3, False)])
def test_a_dismissed_object_comes_back_once_after_all_places(make_record, n_looks, comes_back):
    record = make_record(at=(6.0, 1.0), confidence=0.8, label_robot="chair", confidence_robot=0.8)
    state = dismissed_before(record, looked_from=[(4.0, 1.0)] * n_looks)
    assert candidates([record], state, TWICE) == ([record] if comes_back else [])


def test_a_copy_of_the_memory_has_places_of_its_own():
    here = FloorMemory(looked_from={1: [(0.0, 0.0)]})
    other = replace(here).copy()
    other.record_looked_from(1, 1.0, 1.0)
    assert here.looked_from == {1: [(0.0, 0.0)]}
