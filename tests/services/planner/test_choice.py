"""The decision: which of the options is chosen, and that asking changes nothing."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.planner.core import MissionState, PlannerConfig, sequence
from surveilnav.services.planner.core.choice import Choice, choose
from surveilnav.services.planner.core.choice_rules import _PAPERS_ORDER, highest_utility, papers_order
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.memory.waypoint import CurrentWaypoint
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.options.frontiers import by_chance_per_metre, only
from surveilnav.services.planner.core.options.option import Option
from surveilnav.services.planner.core.options.other_floors import unless_objects_come_first
from surveilnav.services.planner.core.sequence import expected_way_m

CONFIG = PlannerConfig()
SETTINGS = SimpleNamespace(config=CONFIG)
KINDS = ("target", "candidate", "stairs", "frontier")
ROOMS = """
##########################################
#                   #                    #
#                   #              CC    #
#                                  CC    #
#                                        #
#   R                                    #
#                   #                    #
##########################################
"""


def option(kind="frontier", utility=0.1, **more):
    return Option(kind, 0.0, 0.0, utility, 1.0, utility, "", **more)


options = st.lists(
    st.builds(
        option,
        kind=st.sampled_from(KINDS),
        utility=st.floats(0.001, 1.0),
        is_current=st.booleans(),
    ),
    min_size=1,
    max_size=8,
)


@given(options)
def test_the_highest_utility_wins_unless_the_current_one_is_nearly_as_good(proposed):
    """Against the rule written out, option by option."""
    chosen = highest_utility(proposed, SETTINGS)
    most = max(o.utility for o in proposed)
    current = [o.utility for o in proposed if o.is_current]
    keeps = bool(current) and most <= CONFIG.switch_ratio * max(current)
    assert chosen.utility == (max(current) if keeps else most)
    assert chosen.is_current or not keeps


@given(options)
def test_the_papers_order_compares_only_within_the_first_kind(proposed):
    chosen = papers_order(proposed, SimpleNamespace(config=CONFIG.changed(switch_ratio=1.0)))
    first = next(kind for kind in KINDS if any(o.kind == kind for o in proposed))
    assert chosen.kind == first
    assert chosen.utility == max(o.utility for o in proposed if o.kind == first)


def test_an_accepted_last_resort_comes_first_in_either_order():
    accepted = option("candidate", 1.0, is_accepted=True)
    among = [option("target", 0.3), accepted, option("frontier", 0.2)]
    assert highest_utility(among, SETTINGS) is accepted
    assert papers_order(among, SETTINGS) is accepted


def context_of(world, state, config=CONFIG, rule=by_chance_per_metre, **changes):
    maps = replace(world.maps(), **changes)
    return StepContext.from_inputs(state, maps, world.robot(), config, FmmPlanner(), {}, rule)


def test_asking_changes_nothing_at_any_step_of_a_search(world, thing):
    """What was remembered before the choice is remembered after it, and a second choice is the same."""
    w = world(ROOMS, {"C": thing("chair", looks_like="chair", known={"label": "chair", "confidence": 0.3})})
    kinds = set()

    def watch(maps, robot, state, decision):
        context = StepContext.from_inputs(state, maps, robot, CONFIG, FmmPlanner(), {}, by_chance_per_metre)
        before = state.to_json()
        choice = choose(context)
        assert state.to_json() == before
        assert choose(context) == choice
        if choice is not None:
            kinds.add(choice.chosen.kind)
            assert choice.compared[0] is choice.chosen
            assert len({id(o) for o in choice.compared}) == len(choice.compared)

    w.run(watch=watch)
    assert {"frontier", "candidate"} <= kinds


def test_what_is_shown_has_chance_cost_and_utility(world):
    """The numbers by which options are compared are those that people see."""
    shown = []
    world(ROOMS).run(max_steps=40, watch=lambda m, r, s, d: shown.extend(d.candidates))
    assert {c.kind for c in shown} >= {"frontier"}
    for c in shown:
        assert c.cost_m > 0.0
        assert 0.0 <= c.chance <= 1.0
        assert c.utility == pytest.approx(c.chance / c.cost_m)


def test_what_is_blacklisted_for_a_while_is_tried_before_the_floor_counts_as_searched(world):
    """The only frontier failed once: nothing else is left, so it is tried again at once; after a second failure it isn't."""
    w = world(ROOMS)
    state = MissionState("chair", floor="0")
    context = context_of(w, state)
    assert [o.kind for o in choose(context).compared] == ["frontier"] * len(choose(context).compared)
    for o in choose(context).compared:
        state.blacklist_place(o.x_m, o.y_m, CONFIG)
    again = choose(context)
    assert again.chosen.kind == "frontier"
    assert again.searched_chance is None
    for o in again.compared:
        state.blacklist_place(o.x_m, o.y_m, CONFIG)
    after = choose(context)
    assert after.chosen.kind == "second_look"
    assert after.searched_chance == 0.0


@pytest.mark.parametrize(("known_utility", "left"), [(0.02, True), (10.0, False)])
def test_an_object_that_exploring_outdoes_counts_as_oscillating(make_record, known_utility, left):
    record = make_record(id=4, at=(3.0, 3.0))
    state = MissionState("chair", floor="0", waypoint=CurrentWaypoint("candidate", 3.0, 3.0, None, 0, object_id=4))
    here = option("candidate", known_utility, record=record, is_current=True)
    among = [here, option("frontier", 0.1)]
    state.apply(Choice(highest_utility(among, SETTINGS), tuple(among)), CONFIG)
    assert state.here.oscillations == ({4: 1} if left else {})
    assert state.waypoint.kind == ("frontier" if left else "candidate")


def test_an_object_that_is_no_option_any_more_counts_as_oscillating(make_record):
    """It isn't promising any more, and another one is: the robot goes there, and knows that it was sent to and fro."""
    state = MissionState("chair", floor="0", waypoint=CurrentWaypoint("candidate", 3.0, 3.0, None, 0, object_id=4))
    other = option("candidate", 0.1, record=make_record(id=5, at=(8.0, 3.0)))
    state.apply(Choice(other, (other,)), CONFIG)
    assert state.here.oscillations == {4: 1}
    assert state.waypoint.object_id == 5


def test_a_rule_that_chooses_one_frontier_has_it_compared_with_objects(world, make_record):
    """It is worth what any frontier at its distance is; the others aren't explored, however near they are."""

    def farthest(context, found):
        chosen = max(found, key=lambda f: f.travel_time_m)
        return only(context, chosen, found, "farthest")

    w = world(ROOMS)
    state = MissionState("chair", floor="0")
    rated = choose(context_of(w, state, rule=farthest))
    far_m = max(o.cost_m for o in rated.compared)
    assert rated.chosen.cost_m == far_m
    assert rated.chosen.utility == pytest.approx(CONFIG.explore_chance / far_m)
    near = make_record(at=(w.x + 1.0, w.y), confidence=0.15, n_detections=3)
    assert choose(context_of(w, state, rule=farthest, objects=[near])).chosen.record == near


@pytest.mark.parametrize("choice", ["utility", "sequence", "paper"])
def test_a_rule_that_leaves_the_frontier_where_the_robot_is_heading_is_obeyed(world, choice):
    """No hysteresis keeps the robot on its way to a nearer frontier: a rule under test is played as it is."""

    def chooses(x_m):
        def rule(context, found):
            return only(context, min(found, key=lambda f: abs(f.x_m - x_m)), found, "told")

        return rule

    w = world(ROOMS)
    config, state = CONFIG.changed(choice=choice), MissionState("chair", floor="0")
    found = choose(context_of(w, state, config=config)).compared
    ends = min(o.x_m for o in found), max(o.x_m for o in found)
    for heading_for, told in (ends, ends[::-1]):
        at = next(o for o in found if o.x_m == heading_for)
        state.waypoint = CurrentWaypoint("frontier", at.x_m, at.y_m, None, 0)
        assert choose(context_of(w, state, config=config, rule=chooses(told))).chosen.x_m == told


def test_a_choice_asks_the_rule_once(world):
    asked = []

    def rule(context, found):
        asked.append(len(found))
        return by_chance_per_metre(context, found)

    choice = choose(context_of(world(ROOMS), MissionState("chair", floor="0"), rule=rule))
    assert asked == [len(choice.compared)]


@pytest.mark.parametrize(
    ("kind", "is_on_the_way", "is_accepted", "weighed"),
    [
        ("target", False, False, False),
        ("target", True, False, False),
        ("candidate", False, False, False),
        ("candidate", True, False, True),
        ("candidate", False, True, True),
        ("frontier", False, False, True),
    ],
)
def test_stairs_are_weighed_unless_an_object_here_comes_first(kind, is_on_the_way, is_accepted, weighed):
    stairs, other = option("stairs", is_current=is_on_the_way), option(kind, is_accepted=is_accepted)
    assert unless_objects_come_first([other, stairs]) == ([other, stairs] if weighed else [other])


def test_every_kind_of_option_has_a_behaviour():
    from surveilnav.services.planner.core.options.option import OptionKind
    from surveilnav.services.planner.core.step import BEHAVIOURS

    assert set(BEHAVIOURS) == set(OptionKind.__args__) == set(_PAPERS_ORDER)


# --- orders -------------------------------------------------------------------------------------------------------


def expected_by_orders(chance, spend_m, first_m, between_m):
    """The slow reference: every order, written out."""
    n = len(chance)
    best = np.full(n, np.inf)
    for order in itertools.permutations(range(n)):
        way_m, not_found, at = 0.0, 1.0, None
        for i in order:
            way_m += not_found * ((first_m[i] if at is None else between_m[at, i]) + spend_m[i])
            not_found *= 1.0 - chance[i]
            at = i
        best[order[0]] = min(best[order[0]], way_m)
    return best


@pytest.mark.parametrize("seed", range(20))
def test_the_best_order_is_that_of_trying_all(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    chance, spend_m, first_m = rng.uniform(0, 1, n), rng.uniform(0, 5, n), rng.uniform(0, 30, n)
    between_m = rng.uniform(0, 30, (n, n))  # there and back need not be the same
    found = expected_way_m(chance, spend_m, first_m, between_m)
    assert found == pytest.approx(expected_by_orders(chance, spend_m, first_m, between_m))


def test_two_options_behind_one_door_may_beat_a_better_one_on_the_other_side():
    """By chance per metre the robot goes left first; but on the right three options are together."""
    chance, spend_m = np.array([0.16, 0.14, 0.14, 0.14]), np.full(4, 2.0)
    first_m = np.array([6.0, 7.0, 7.0, 7.0])
    between_m = np.array([[0, 13, 13, 13], [13, 0, 1, 1], [13, 1, 0, 1], [13, 1, 1, 0.0]])
    assert int(np.argmax(chance / (first_m + spend_m))) == 0
    assert int(np.argmin(expected_way_m(chance, spend_m, first_m, between_m))) != 0


def test_a_search_in_sequence_finds_and_ends(world, thing):
    w = world(ROOMS, {"C": thing("chair", looks_like="chair")})
    _, decision = w.run(config=PlannerConfig(choice="sequence"))
    assert decision.found
    _, decision = world(ROOMS).run(config=PlannerConfig(choice="sequence"))
    assert decision.error == "not_found"


#: Two rooms side by side without a door between them, each open to a corridor in the north.
WALL = """
##########################
#                        #
#                        #
#                        #
#           #            #
#           #            #
#           #            #
#    R      #            #
#           #            #
##########################
"""


def test_ways_between_options_are_those_of_the_map(world):
    """Of two places 3 m apart with a wall in between, the way is that around the wall, in both directions."""
    w = world(WALL)
    w.explored[:] = 1
    ways_m = {}
    for name, occupancy in (("open", np.zeros_like(w.occupancy)), ("walled", w.solid.astype(np.uint8))):
        context = context_of(w, MissionState("chair", floor="0"), occupancy=occupancy)
        places = [replace(option(), x_m=w.x + dx, y_m=w.y) for dx in (0.25, 3.25)]
        ways_m[name] = sequence._ways_between(context, places)
        assert ways_m[name] == pytest.approx(ways_m[name].T)
        assert ways_m[name].diagonal().max() == 0.0
    assert 1.5 < ways_m["open"][0, 1] < 2.5  # an option is reached within a metre
    assert ways_m["walled"][0, 1] > ways_m["open"][0, 1] + 1.0


@pytest.mark.parametrize(("margin_m", "kept"), [(0.0, False), (50.0, True)])
def test_an_order_is_kept_unless_another_is_shorter_by_a_margin(world, margin_m, kept):
    w = world(WALL)
    w.explored[:] = 1
    context = context_of(w, MissionState("chair", floor="0"), CONFIG.changed(sequence_margin_m=margin_m))
    current = Option("frontier", w.x, w.y + 1.5, 0.1, 4.0, 0.025, "", is_current=True, spend_m=3.0)
    other = Option("frontier", w.x + 0.5, w.y, 0.4, 3.5, 0.114, "", spend_m=3.0)
    assert (sequence.least_expected_way([current, other], context) is current) == kept
