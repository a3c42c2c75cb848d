"""Missions over several floors: which floor, which stair, what is remembered, and that all of it ends."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Grid
from surveilnav.messages import Stair
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.floors import chance_here
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.options.frontiers import by_chance_per_metre
from surveilnav.services.planner.core.options.last_resort import last_resort

#: A hall with a side room; ``C`` a thing in it. The stair's end is at (6.1, 0.9).
FLOOR = """
############################
#            #             #
#            #             #
#                    CC    #
#                    CC    #
#   R        #             #
#            #             #
#            #             #
############################
"""
EMPTY = FLOOR.replace("C", " ")
END = (6.1, 0.9)
GRID = Grid(0.0, 0.0, 0.05, 100, 100)
SEEN = {"0": {}, "1": {"chair": 0.7}}
#: Exploring is never worth more than what was seen, however far it is.
GOES = PlannerConfig(choice="paper")


@pytest.fixture
def two_floors(world, house, thing):
    """A house whose floor 1 has the chair; floor 0 is empty."""

    def make(summaries=None, known=None, **more):
        upper = world(FLOOR, {"C": thing("chair", looks_like="chair")}, floor="1")
        stairs = more.pop("stairs", [("0", END, "1", END)])
        return house([world(EMPTY, floor="0", **(known or {})), upper], stairs, summaries, **more)

    return make


def test_goes_where_the_cameras_saw_it(two_floors):
    """With the other floor's summary the robot leaves before it has explored all; without, only then."""
    steps = {}
    for name, summaries in (("with", SEEN), ("without", {})):
        h = two_floors(summaries)
        state, decision = h.run(config=GOES)
        assert decision.found, decision.message
        assert h.trail == ["0", "1"]
        steps[name] = state.changes[0].step
        assert ("0.70" in state.changes[0].why) == (name == "with")
    assert steps["with"] < 0.7 * steps["without"]


@pytest.mark.parametrize(
    ("here", "there", "leaves"),
    [(0.0, 0.7, True), (0.0, 0.15, False), (0.6, 0.7, False), (0.5, 0.7, True), (0.7, 0.7, False), (0.2, 0.41, True)],
)
def test_evidence_must_be_better_by_a_margin(two_floors, here, there, leaves):
    """At the first step, when the joint map may not hold what this floor's own cameras see."""
    decisions = []
    two_floors({"0": {"chair": here}, "1": {"chair": there}}).run(
        config=GOES.changed(stairs_known="plan"), watch=lambda s, d: decisions.append(d)
    )
    assert decisions[0].phase == ("changing floor" if leaves else "scanning")


@pytest.mark.parametrize(("missing_for", "first"), [(0, "changing floor"), (1, "scanning"), (20, "scanning")])
def test_no_floor_is_left_before_its_cameras_views_have_come(two_floors, missing_for, first):
    """They may show the target here. The robot looks around meanwhile, and then explores."""
    h, phases = two_floors(SEEN), []
    here = h.now
    here.maps = lambda maps=here.maps: replace(maps(), pending_views=4 if len(phases) < missing_for else 0)
    state, decision = h.run(config=GOES.changed(stairs_known="plan"), watch=lambda s, d: phases.append(d.phase))
    assert phases[0] == first
    assert decision.found
    assert h.trail == ["0", "1"]
    assert phases.index("changing floor") >= missing_for
    assert state.changes[0].step >= missing_for


def test_views_that_never_come_bind_the_robot_only_until_its_floor_is_searched(two_floors):
    h = two_floors(SEEN)
    here = h.now
    here.maps = lambda maps=here.maps: replace(maps(), pending_views=4)
    _, decision = h.run(config=GOES.changed(stairs_known="plan"))
    assert decision.found, decision.message
    assert h.trail == ["0", "1"]


def test_what_most_floors_have_is_searched_for_here_first(two_floors):
    """The surer a floor has the target anyway, the more of it is explored before the robot leaves; but leave it does."""
    phases, left_at = {}, {}
    for chance in (0.2, 0.999):
        config = PlannerConfig(stairs_known="plan", floor_chance=chance, explore_chance=0.15)
        decisions = []
        state, decision = two_floors(SEEN).run(config=config, watch=lambda s, d, to=decisions: to.append(d))
        assert decision.found, decision.message
        phases[chance], left_at[chance] = decisions[0].phase, state.changes[0].step
    assert phases == {0.2: "changing floor", 0.999: "scanning"}
    assert left_at[0.2] + 12 < left_at[0.999], "more than a look around is done here first"


def test_a_floor_that_surely_has_the_target_is_never_left(two_floors):
    state, decision = two_floors(SEEN).run(config=PlannerConfig(stairs_known="plan", floor_chance=1.0))
    assert (decision.error, state.changes) == ("not_found", [])


def test_the_chance_here_is_by_bayes():
    """Against the formula written out: one in 11 m of exploring, 22 m walked, where half of the floors have one."""
    walked = [(0.25 * i, 0.0) for i in range(89)]
    state = MissionState("chair", floor="0", floors={"0": FloorMemory(visited=walked)})
    config = PlannerConfig(floor_chance=0.5, explore_chance=3.0 / 11.0, explore_cost_m=3.0)
    context = SimpleNamespace(state=state, config=config)
    missed = math.exp(-2.0)
    assert chance_here(context) == pytest.approx(0.5 * missed / (0.5 * missed + 0.5))


def test_an_unseen_stair_is_not_headed_for_unless_the_plan_is_known(two_floors):
    """The robot faces west: the stair in the east isn't explored at first."""
    first = {}
    for known in ("seen", "plan"):
        h = two_floors(SEEN, {"yaw_rad": math.pi})
        decisions = []
        h.run(config=GOES.changed(stairs_known=known), watch=lambda s, d, to=decisions: to.append(d))
        first[known] = decisions[0].phase
        assert decisions[-1].found
    assert first == {"seen": "scanning", "plan": "changing floor"}


def test_something_promising_here_comes_first(world, house, thing):
    known = {"label": "chair", "confidence": 0.5}
    lower = world(FLOOR, {"C": thing("table", looks_like="dining table", known=known)}, floor="0")
    upper = world(FLOOR, {"C": thing("chair", looks_like="chair")}, floor="1")
    h = house([lower, upper], [("0", END, "1", END)], {"0": {"chair": 0.5}, "1": {"chair": 0.55}})
    state, decision = h.run()
    assert decision.found
    assert lower.things["C"].detections  # looked at, and no chair
    assert "saw" in state.changes[0].why
    assert h.trail == ["0", "1"]


def test_all_floors_are_searched_once_before_it_ends(world, house):
    floors = [world(EMPTY, floor=name) for name in ("0", "1", "2")]
    h = house(floors, [("0", END, "1", END), ("1", (4.5, 1.0), "2", (4.5, 1.0))])
    state, decision = h.run(max_steps=900)
    assert decision.error == "not_found"
    assert h.trail == ["0", "1", "2"]
    assert all(memory.is_searched for memory in state.floors.values())


def test_cameras_that_are_wrong_about_both_floors_do_not_make_it_swing(world, house):
    """Both summaries insist; nothing is there. The robot goes to each floor once and gives up."""
    h = house([world(EMPTY, floor=n) for n in "01"], [("0", END, "1", END)], {"0": {"chair": 0.6}, "1": {"chair": 0.9}})
    state, decision = h.run(max_steps=900)
    assert decision.error == "not_found"
    assert h.trail == ["0", "1", "0"]
    assert len(state.changes) == 2


def test_through_a_floor_between(world, house, thing):
    """Seen on floor 2: floor 1 is only crossed."""
    top = world(FLOOR, {"C": thing("chair", looks_like="chair")}, floor="2")
    floors = [world(EMPTY, floor="0"), world(EMPTY, floor="1"), top]
    stairs = [("0", END, "1", END), ("1", (5.0, 1.0), "2", (5.0, 1.0))]
    h = house(floors, stairs, {"2": {"chair": 0.8}})
    _, decision = h.run()
    assert decision.found
    assert h.trail == ["0", "1", "2"]
    assert len(floors[1].trace) < 25


@pytest.mark.parametrize(
    ("to_1_m", "to_2_m", "seen", "first"), [(3.0, 9.0, 0.0, "1"), (9.0, 3.0, 0.0, "2"), (3.0, 9.0, 0.15, "1")]
)
def test_the_nearest_floor_comes_first_without_evidence(world, house, to_1_m, to_2_m, seen, first):
    """A faint hint about floor 2 is no evidence."""
    floors = [world(EMPTY, floor=n) for n in ("0", "1", "2")]
    h = house(floors, [("0", END, "1", END, to_1_m), ("0", END, "2", END, to_2_m)], {"2": {"chair": seen}})
    h.run(max_steps=900)
    assert h.trail[1] == first


def test_coming_back_remembers_the_floor(world, house):
    h = house([world(EMPTY, floor=n) for n in "01"], [("0", END, "1", END)], {"0": {"chair": 0.6}, "1": {"chair": 0.9}})
    scans = []
    state, _ = h.run(max_steps=900, watch=lambda s, d: scans.append(s.floor) if d.phase == "scanning" else None)
    assert h.trail == ["0", "1", "0"]
    assert len(state.floors["0"].visited) > 10
    assert len(state.floors["1"].visited) > 10
    assert scans.count("1") <= 12
    assert scans.count("0") <= 12


@pytest.mark.parametrize(("refuses", "found"), [(1, True), (2, True), (3, False)])
def test_a_refused_stair_is_tried_nearer_and_then_barred(two_floors, refuses, found):
    h = two_floors(SEEN, refuses=refuses)
    state, decision = h.run(max_steps=600)
    assert decision.found == found
    if not found:
        assert decision.error == "unreachable"
        assert "(6.1, 0.9) to floor 1" in decision.message
        assert state.floors["0"].stairs_failures == {"(6.1, 0.9)": 3}


def test_another_stair_is_taken_when_one_is_shut(two_floors):
    """The nearer stair's end lies within walls."""
    shut = ("0", (3.1, 0.1), "1", END)
    h = two_floors(SEEN, stairs=[shut, ("0", END, "1", END)])
    _, decision = h.run()
    assert decision.found
    assert h.trail == ["0", "1"]


def test_a_stair_counts_by_its_length(two_floors):
    h = two_floors(SEEN)
    before = {}

    def watch(state, decision):
        before[decision.action] = before.get(decision.action, 0) + 1

    state, _ = h.run(watch=watch)
    assert state.step >= sum(before.values()) + 15  # 4 m of stairs are 16 moves


def test_the_best_of_what_was_dismissed_on_another_floor(world, house, thing):
    """Nothing is ever confirmed: at the end the robot goes back to the floor with the best candidate."""
    import msgspec

    lower = world(
        FLOOR, {"C": thing("chair", looks_like="chair", known={"label": "chair", "confidence": 0.5})}, floor="0"
    )
    objects = lower.objects
    lower.objects = lambda: [
        msgspec.structs.replace(
            o, status="candidate", confidence=min(o.confidence, 0.5), confidence_robot=0.35 * (o.confidence_robot > 0)
        )
        for o in objects()
    ]
    h = house([lower, world(EMPTY, floor="1")], [("0", END, "1", END)])
    _, decision = h.run(max_steps=900)
    assert h.trail == ["0", "1", "0"]
    assert decision.found
    assert "nothing better was found" in decision.message


@pytest.mark.parametrize(("accepted", "goes"), [(None, False), (3, True)])
def test_what_was_accepted_in_vain_holds_nobody_back(accepted, goes):
    """The better candidate was here; once it was tried, the weaker one on the other floor is next."""
    state = MissionState("chair", floor="0")
    state.here.best_remaining_chance, state.here.accepted_object = 0.4, accepted
    state.floors["1"] = FloorMemory(best_remaining_chance=0.35, visits=1, is_searched=True)
    explored = np.ones(GRID.shape, np.uint8)
    unknown = np.full(GRID.shape, np.nan, np.float32)
    maps = FloorMaps("0", 0.0, GRID, np.zeros_like(explored), explored, np.zeros_like(explored), unknown, [], 1)
    stairs = Stair(floor="0", at_m=(3.0, 3.0, 0.0), to_floor="1", to_m=(3.0, 3.0, 3.0), length_m=4.0)
    robot = RobotView(0, 1.0, 1.0, 0.0, 0.0, "0", False, None, 0.0, (stairs,))
    context = StepContext.from_inputs(state, maps, robot, PlannerConfig(), FmmPlanner(), {}, by_chance_per_metre)
    options = last_resort(context)
    assert [(o.kind, o.floor_goal.to_floor, o.chance) for o in options] == [("stairs", "1", 0.35)] * goes


def test_a_floor_that_no_way_leads_to_hides_no_other(two_floors):
    """One summary of a floor without a stair says more than that of the floor upstairs."""
    h = two_floors({"1": {"chair": 0.7}, "attic": {"chair": 0.95}})
    state, decision = h.run()
    assert decision.found
    assert "searched" not in state.changes[0].why, "it leaves before all here is explored"


@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(every=st.integers(1, 40))
def test_a_resumed_mission_decides_as_one_never_interrupted(two_floors, every):
    """The state goes through JSON at every ``every``-th step: equal, and the same decisions to the end."""

    def play(through_json):
        said = []

        def watch(state, decision):
            said.append(decision)
            again = MissionState.from_json(state.to_json())
            assert again == state
            return again if through_json and state.step % every == 0 else state

        two_floors(SEEN).run(watch=watch)
        return said

    assert play(True) == play(False)
