"""Whole missions in a flat world: what is found, where the robot stops, and that every mission ends."""

from __future__ import annotations

import itertools
import math
import sys

import msgspec
import numpy as np
import pytest

from surveilnav.services.planner.core import MissionState, PlannerConfig, step

#: Two rooms, joined by a door of 0.75 m.
TWO_ROOMS = """
##########################################
#                   #                    #
#                   #                    #
#                   #              CC    #
#                   #              CC    #
#                   #                    #
#                   #                    #
#                                        #
#                                        #
#                                        #
#                   #                    #
#   R               #                    #
#                   #                    #
#                   #                    #
##########################################
"""
#: The chair stands behind glass, so to say: its room has no door.
NO_DOOR = """
#################################
#                 #             #
#                 #             #
#                 #     CC      #
#   R             #     CC      #
#                 #             #
#                 #             #
#################################
"""


def test_explores_finds_and_stops_near(world, thing):
    w = world(TWO_ROOMS, {"C": thing("chair", looks_like="chair")}, yaw_rad=math.pi)
    state, decision = w.run()
    assert decision.found
    assert decision.action == "stop"
    assert w.gap_m("C") <= 0.85
    assert state.step < 120
    assert w.path_m < 1.6 * math.dist(w.trace[0], w.trace[-1])


@pytest.mark.parametrize("skip_scan_within_m", [3.0, 30.0])
def test_surveillance_needs_no_exploring_and_near_by_no_look_around(world, thing, skip_scan_within_m):
    known = {"label": "chair", "confidence": 0.9, "status": "confirmed"}
    w = world(TWO_ROOMS, {"C": thing("chair", looks_like="chair", known=known)}, yaw_rad=0.5)
    phases = []
    config = PlannerConfig(skip_scan_within_m=skip_scan_within_m)
    _, decision = w.run(config=config, watch=lambda m, r, s, d: phases.append(d.phase))
    assert decision.found
    assert phases.count("scanning") == (config.scan_turns if skip_scan_within_m == 3.0 else 0)
    assert "exploring" not in phases


def test_false_positive_is_dismissed_and_search_goes_on(world, thing):
    drawing = TWO_ROOMS.replace("#   R               #", "#   R      TT       #")
    known = {"label": "chair", "confidence": 0.9, "status": "confirmed"}
    things = {"T": thing("table", looks_like="dining table", known=known), "C": thing("chair", looks_like="chair")}
    w = world(drawing, things, yaw_rad=math.pi)
    objects = w.objects
    w.objects = lambda: [  # the map believes the robot, too
        msgspec.structs.replace(o, confidence=0.5) if o.label_robot == "dining table" else o for o in objects()
    ]
    state, decision = w.run()
    assert decision.found
    assert w.gap_m("C") <= PlannerConfig().stop_m
    assert 1 in state.here.dismissed


def test_unconfirmed_by_the_robot_is_dismissed(world, thing):
    """What cameras confirmed and is less likely after the robot's looks: two levels say no, ``paper`` says yes."""
    known = {"label": "chair", "confidence": 0.6, "status": "confirmed"}
    w = world(TWO_ROOMS, {"C": thing("chair", known=known)})
    state, decision = w.run()
    assert not decision.found
    assert decision.error == "not_found"
    assert state.here.dismissed
    w = world(TWO_ROOMS, {"C": thing("chair", known=known)})
    _, decision = w.run(config=PlannerConfig(verification="paper"))
    assert decision.found
    assert w.gap_m("C") <= 0.85


def test_strong_surveillance_is_believed_at_last(world, thing):
    known = {"label": "chair", "confidence": 0.9, "status": "confirmed"}
    w = world(TWO_ROOMS, {"C": thing("chair", known=known)})
    objects = w.objects
    w.objects = lambda: [msgspec.structs.replace(o, n_detections=5) for o in objects()]
    _, decision = w.run()
    assert decision.found
    assert "likely enough" in decision.message


def test_ends_unreachable(world, thing):
    known = {"label": "chair", "confidence": 0.9, "status": "confirmed"}
    w = world(NO_DOOR, {"C": thing("chair", known=known)})
    state, decision = w.run()
    assert decision.error == "unreachable"
    assert not decision.found
    assert "chair" in decision.message
    assert state.step < 200


def test_ends_not_found_when_nothing_is_left(world):
    w = world(TWO_ROOMS)
    state, decision = w.run()
    assert decision.error == "not_found"
    assert decision.action is None
    free = ~w.solid[21:-21, 21:-21]
    assert w.explored[21:-21, 21:-21][free].mean() > 0.97
    assert state.step < 250


def test_what_was_only_glanced_at_is_looked_at_again(world, thing):
    """A detector that sees no farther than 1.2 m: exploring alone passes the chair by, looking around again finds it."""
    found = {}
    for second_look_m in (None, 2.0):
        w = world(ONE_HALL, {"C": thing("chair", looks_like="chair")}, sees_from_m=1.2)
        _, decision = w.run(config=PlannerConfig(second_look_m=second_look_m))
        found[second_look_m] = decision.found
    assert found == {None: False, 2.0: True}


@pytest.mark.parametrize("status", ["candidate", "rejected"])
def test_what_the_robot_takes_for_the_target_is_accepted_when_nothing_else_is_left(world, thing, status):
    """It does so all along, but fusion never confirms it, or rejects it."""
    for least, found in ((0.30, True), (None, False)):
        w = world(TWO_ROOMS, {"C": thing("chair", looks_like="chair", known={"label": "chair", "confidence": 0.5})})
        objects = w.objects
        w.objects = lambda objects=objects: [
            msgspec.structs.replace(o, status=status, confidence=0.5, confidence_robot=0.35 * (o.confidence_robot > 0))
            for o in objects()
        ]
        _, decision = w.run(config=PlannerConfig(last_resort_chance=least))
        assert decision.found is found, decision.message
        assert not found or "nothing better was found" in decision.message


def test_out_of_steps(world):
    state, decision = world(TWO_ROOMS).run(max_steps=20)
    assert decision.error == "out_of_steps"
    assert state.step == 20


def test_a_robot_that_cannot_move_ends_stuck(world):
    w = world(TWO_ROOMS)
    act = w.act

    def stand(action):
        act("turn_left" if action == "turn_left" else "stop")
        w.last, w.collided = action, action == "move_forward"

    w.act = stand
    state, decision = w.run()
    assert decision.finished
    assert decision.error == "stuck"
    assert state.step < 200


ONE_HALL = """
########################
#                      #
#                      #
#   R                  #
#                      #
#                      #
#                      #
#                    C #
########################
"""


#: South of the start a gap of 0.25 m, through which the robot sees a yard but can't pass; the way on is in the east.
WINDOW = """
##########################################
#                      #                 #
#                      #                 #
#                                        #
#                                        #
#   R                                  CC#
#                      #               CC#
#                      #                 #
#####.####################################
                                    #
                                    #
                                    #
                                    #
#####################################
"""


@pytest.mark.parametrize(("constrained_detour_m", "soon"), [(4.0, True), (1e9, False)])
def test_what_is_seen_through_a_gap_comes_last(world, thing, constrained_detour_m, soon):
    """The yard looks promising, but only a map has a way there: the rooms are explored first."""
    w = world(WINDOW, {"C": thing("chair", looks_like="chair")}, yaw_rad=-1.5, sees_from_m=5.0)
    w.value[:] = 0.1
    w.value[: w.grid.cells_of((0.0, 1.2))[0]] = 0.9
    state, decision = w.run(config=PlannerConfig(constrained_detour_m=constrained_detour_m))
    assert decision.found
    assert (state.step < 60) == soon


@pytest.mark.parametrize("strategy", ["greedy", "object", "region"])
def test_no_swinging(world, strategy):
    """Never turns left then right (or the reverse) on the spot while driving, and never paces the same metre."""
    w = world(TWO_ROOMS, yaw_rad=1.0)
    rng = np.random.default_rng(1)
    w.value[:] = rng.random(w.value.shape).astype(np.float32) * 0.3
    actions = []
    w.run(config=PlannerConfig(strategy=strategy), watch=lambda m, r, s, d: actions.append(d.action))
    swings = sum({a, b} == {"turn_left", "turn_right"} for a, b in itertools.pairwise(actions))
    assert swings <= 6
    cells = [(round(x * 2), round(y * 2)) for x, y in w.trace]
    visits = np.unique([c for i, c in enumerate(cells) if i == 0 or c != cells[i - 1]], axis=0, return_counts=True)[1]
    assert visits.max() <= 6


def test_state_is_not_changed(world):
    w = world(TWO_ROOMS)
    state = MissionState("chair")
    before = repr(state)
    step(state, w.maps(), w.robot(), PlannerConfig())
    assert repr(state) == before


def test_narrow_start_between_walls(world):
    """Starts inside grown obstacles and gets out."""
    drawing = TWO_ROOMS.replace("#   R               #", "# # R #             #").replace(
        "#                   #                    #\n#                   #                    #\n####",
        "# #   #             #                    #\n# #####             #                    #\n####",
    )
    w = world(drawing, yaw_rad=0.0)
    w.x -= 0.2
    _state, decision = w.run()
    assert decision.error == "not_found"
    assert max(x for x, _ in w.trace) > 4.0


def test_path_never_crosses_known_obstacles(world):
    def watch(maps, robot, state, decision):
        if len(decision.path) > 2:
            path = np.array(decision.path[1:])
            t = np.linspace(0, 1, 5)[:, None, None]
            fine = (path[:-1] + t * (path[1:] - path[:-1])).reshape(-1, 2)
            cells = maps.grid.cells_of(fine)
            assert not maps.occupancy[cells[:, 0], cells[:, 1]].any()

    world(TWO_ROOMS).run(watch=watch)


def test_an_option_that_fails_without_end_is_a_bug_that_ends(world, monkeypatch):
    """A behaviour that can't do anything about its option, and doesn't record that."""
    monkeypatch.setitem(sys.modules[step.__module__].BEHAVIOURS, "frontier", lambda context, option: None)
    with pytest.raises(RuntimeError, match="chosen without end"):
        world(TWO_ROOMS).run()
