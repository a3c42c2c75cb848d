"""Objects that the robot isn't heading for, and the reasons that people are told."""

from __future__ import annotations

from dataclasses import replace

import pytest

from surveilnav.messages import Candidate
from surveilnav.services.planner.core import MissionState, PlannerConfig, step
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.memory.floor_memory import DismissedObject
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.options.frontiers import by_chance_per_metre
from surveilnav.services.planner.core.options.unchosen_objects import unchosen_objects

CONFIG = PlannerConfig()
HALL = """
##################
#                #
#  R             #
#                #
##################
"""
AT = (3.0, 0.75)


@pytest.fixture
def hall(world):
    return world(HALL)


def told(hall, objects, state=None, known=()):
    state = state or MissionState("chair", floor="0")
    maps = replace(hall.maps(), objects=objects)
    context = StepContext.from_inputs(state, maps, hall.robot(), CONFIG, FmmPlanner(), {}, by_chance_per_metre)
    return unchosen_objects(context, known)


def rejected(record, state):
    return {"status": "rejected", "reason": "a couch from near by"}


def dismissed(record, state):
    state.dismiss(record, "not confirmed")


def dismissed_beside(record, state):
    state.here.dismissed[99] = DismissedObject(*AT, "not confirmed")


def failed(record, state):
    state.blacklist_place(*AT, CONFIG)


def oscillating(record, state):
    state.here.oscillations[record.id] = 5


def far_off(record, state):
    return {"at": (300.0, 300.0)}


def faint(record, state):
    return {"confidence": 0.01}


def sure(record, state):
    return {"status": "confirmed"}


@pytest.mark.parametrize(
    ("happened", "why"),
    [
        (rejected, "the maps rejected it: a couch from near by"),
        (dismissed, "dismissed it: not confirmed"),
        (dismissed_beside, "looked at this place"),
        (failed, "going there failed"),
        (oscillating, "views disagree"),
        (far_off, "no way leads there"),
        (faint, "exploring comes first"),
        (sure, "something else is worth more"),
    ],
)
def test_each_has_its_reason(hall, make_record, happened, why):
    state = MissionState("chair", floor="0")
    record = make_record(id=7, at=AT, confidence=0.9, n_detections=5)
    changes = happened(record, state) or {}
    record = make_record(id=7, **({"at": AT, "confidence": 0.9, "n_detections": 5} | changes))
    (candidate,) = told(hall, [record], state)
    assert why in candidate.note
    assert (candidate.object_id, candidate.chosen) == (7, False)
    assert candidate.kind == ("target" if happened is sure else "candidate")


def test_only_what_may_be_the_target_and_isnt_told_of_already(hall, make_record):
    objects = [make_record(id=i, at=AT, label="chair" if i < 30 else "tv", confidence=i / 100) for i in range(40)]
    known = [Candidate("candidate", *AT, 0.1, True, "", 29)]
    shown = told(hall, objects, known=known)
    assert [c.object_id for c in shown] == list(range(28, 16, -1))  # the likeliest twelve


def test_a_step_tells_of_them_and_decides_as_before(hall, make_record):
    objects = [make_record(id=1, at=AT, status="rejected")]
    _, with_object = step(MissionState("chair"), replace(hall.maps(), objects=objects), hall.robot(), CONFIG)
    _, without = step(MissionState("chair"), hall.maps(), hall.robot(), CONFIG)
    assert [c.object_id for c in with_object.candidates if c.object_id is not None] == [1]
    assert replace(with_object, candidates=()) == replace(without, candidates=())
