"""Which frontier each rule goes to."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from surveilnav.benchmark.policies import (
    POLICIES,
    Task,
    Truth,
    apexnav,
    cooccurrence,
    cow,
    esc,
    l3mvn,
    perfect_frontiers,
    vlfm,
)
from surveilnav.benchmark.policies.cooccurrence import Cooccurrence, count_train, of_train
from surveilnav.benchmark.policies.perfect_frontiers import PerfectFrontierRule
from surveilnav.errors import AssetError
from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.simulator.world.labels import TARGETS


def frontier(travel_time_m, value=math.nan, n_cells=20, x_m=0.0, y_m=0.0):
    return Frontier(x_m, y_m, n_cells, travel_time_m, value, value)


def thing(label, x_m, y_m, status="candidate"):
    return ObjectRecord(
        id=1,
        label=label,
        floor="0",
        status=status,
        confidence=0.6,
        confidence_robot=0.6,
        confidence_surveillance=0.0,
        label_robot=label,
        label_surveillance="",
        n_detections=2,
        n_points=50,
        center_m=(x_m, y_m, 0.5),
        size_m=(0.5, 0.5, 0.5),
        first_seen_ns=0,
        last_seen_ns=0,
        sources=[],
        reason="",
    )


def context_of(found, target="toilet", things=(), heading_for=None, floor="0", step=0):
    """What rules ask of a step's context."""
    waypoint = heading_for and SimpleNamespace(kind="frontier", x_m=heading_for[0], y_m=heading_for[1])
    return SimpleNamespace(
        config=PlannerConfig(),
        frontiers=found,
        maps=SimpleNamespace(objects=list(things)),
        robot=SimpleNamespace(x_m=0.0, y_m=0.0, yaw_rad=0.0, floor=floor),
        state=SimpleNamespace(target=target, waypoint=waypoint, step=step),
    )


def chosen_of(rated):
    """The only one that is worth going to."""
    (chosen,) = [r.frontier for r in rated if r.utility > 0.0]
    return chosen


# --- VLFM ---------------------------------------------------------------------------------------------------------

NEAR, FAR = frontier(1.0, 0.30), frontier(9.0, 0.32)


@pytest.mark.parametrize(
    ("held", "last_value", "chosen"),
    [
        (None, 0.0, FAR),  # the way costs nothing
        (NEAR, 0.30, NEAR),  # kept as long as it is worth what it was
        (NEAR, 0.305, NEAR),
        (NEAR, 0.31, FAR),  # it lost 0.01
        (FAR, 0.40, FAR),  # it lost more, and is the best all the same
    ],
)
def test_vlfm(held, last_value, chosen):
    assert vlfm.best([NEAR, FAR], held, last_value) is chosen


def test_vlfm_takes_the_nearest_of_equals():
    assert vlfm.best([frontier(3.0, 0.3), frontier(2.0, 0.3)], None, 0.0).travel_time_m == 2.0


# --- ApexNav ------------------------------------------------------------------------------------------------------


def test_apexnav_tours_those_near_the_best():
    found = [frontier(5.0, 0.50), frontier(2.0, 0.49), frontier(1.0, 0.45), frontier(1.5, 0.10), frontier(1.0)]
    assert apexnav.good_ones(found, apexnav.CONFIG) == found[:2][::-1]


def test_apexnav_does_not_begin_with_the_nearest_if_that_costs_the_tour():
    """The robot stands at 0 on a line."""
    at = np.array([-1.0, 1.2, 3.0])
    found = [frontier(abs(x), 0.5) for x in at]
    assert apexnav.first_of_tour(found, abs(at[:, None] - at)) is found[0]
    at = np.array([-1.1, 1.0, -9.0])
    found = [frontier(abs(x), 0.5) for x in at]
    assert apexnav.first_of_tour(found, abs(at[:, None] - at)) is found[1]
    at = np.array([-3.0, 1.0, 9.0, 1.5])
    found = [frontier(abs(x), 0.5) for x in at]
    assert apexnav.first_of_tour(found, abs(at[:, None] - at)) is found[0]


# --- L3MVN --------------------------------------------------------------------------------------------------------

ROOMS = [["bed", "chair"]] * 8 + [["toilet", "sink"]] * 8 + [["couch", "tv", "chair"]] * 8 + [["sink", "oven"]] * 2
KNOWN = Cooccurrence.of_rooms(ROOMS)


def test_l3mvn_goes_where_the_target_is_likely():
    found = [frontier(1.0, x_m=0.0), frontier(4.0, x_m=10.0)]
    things = [thing("bed", 1.0, 1.0), thing("sink", 11.0, 1.0), thing("chair", 3.0, 0.0)]
    scored = l3mvn.scored(found, things, "toilet", KNOWN)
    assert l3mvn.likeliest(scored).x_m == 10.0
    assert l3mvn.likeliest(l3mvn.scored(found, things, "bed", KNOWN)).x_m == 0.0


def test_l3mvn_counts_nothing_rejected_unknown_or_beyond_the_window():
    found = [frontier(1.0)]
    bare = l3mvn.scored(found, [], "toilet", KNOWN)
    others = [thing("sink", 2.1, 0.0), thing("sink", 1.0, 0.0, "rejected"), thing("vase", 0.5, 0.5)]
    assert l3mvn.scored(found, others, "toilet", KNOWN) == bare
    assert l3mvn.scored(found, [thing("sink", 1.9, 1.9)], "toilet", KNOWN) != bare


def test_l3mvn_without_objects_goes_by_cost_and_utility():
    small, large, near = frontier(4.0, n_cells=10), frontier(4.5, n_cells=20), frontier(2.0, n_cells=13)
    scored = l3mvn.scored([small, large, near], [], "toilet", KNOWN)
    assert [f.n_cells for f in scored] == [13, 20, 10]
    assert l3mvn.likeliest(scored).n_cells == 13
    assert [round(f.score, 3) for f in scored] == [0.2, round(0.1 + 0.1 * 20 / 21, 3), round(0.1 + 0.1 * 10 / 21, 3)]


def test_l3mvn_looks_at_the_four_best_within_reach():
    found = [frontier(1.0 + i, n_cells=30 - i) for i in range(4)] + [
        frontier(4.9, n_cells=5),
        frontier(6.0, n_cells=90),
    ]
    scored = l3mvn.scored(found, [], "toilet", KNOWN)
    assert len(scored) == 4
    assert all(f.travel_time_m < 5.0 and f.n_cells > 5 for f in scored)
    assert l3mvn.scored(found[-1:], [], "toilet", KNOWN)[0].n_cells == 90


@pytest.mark.parametrize(
    ("scores", "chosen"), [((0.15, 0.4, 0.31), 1), ((0.05, 0.15, 0.25), 1), ((0.02, 0.05, 0.01), 0)]
)
def test_l3mvn_thresholds(scores, chosen):
    found = [replace(frontier(1.0), score=s) for s in scores]
    assert l3mvn.likeliest(found) is found[chosen]


def test_likelihoods_are_shares():
    for near in ([], ["sink"], ["bed", "chair"], ["zebra"]):
        shares = {t: KNOWN.likelihood(t, near) for t in TARGETS}
        assert math.isclose(sum(shares.values()), 1.0)
    assert max(TARGETS, key=lambda t: KNOWN.likelihood(t, ["sink"])) == "toilet"
    assert max(TARGETS, key=lambda t: KNOWN.likelihood(t, ["couch"])) in ("tv", "couch", "chair")
    assert max(TARGETS, key=lambda t: KNOWN.likelihood(t, ["toilet"])) == "toilet"
    assert KNOWN.likelihood("zebra", ["sink"]) == 0.0


@pytest.mark.assets
def test_the_committed_counts_are_what_the_command_makes():
    try:
        made = count_train()
    except AssetError as error:
        pytest.skip(str(error))
    assert made.to_json() == cooccurrence._PATH.read_text()
    assert made == of_train()


def test_counts_survive_the_file(tmp_path, monkeypatch):
    path = tmp_path / "counts.json"
    path.write_text(KNOWN.to_json())
    monkeypatch.setattr(cooccurrence, "_PATH", path)
    of_train.cache_clear()
    try:
        assert of_train() == KNOWN
    finally:
        of_train.cache_clear()


@pytest.mark.parametrize(
    ("target", "near", "low", "high"),
    [
        ("toilet", ["sink"], 0.73, 0.75),  # 8 of the 10 rooms with a sink
        ("toilet", ["sink", "oven"], 0.64, 0.67),  # never one with an oven
        ("toilet", ["bed"], 0.0, 0.2),
        ("toilet", [], 0.3, 0.33),  # 8 of 26 rooms
        ("toilet", ["zebra"], 0.3, 0.33),
        ("toilet", ["toilet"], 0.89, 0.91),
        ("zebra", ["sink"], 0.0, 0.0),
    ],
)
def test_the_chance_that_a_room_has_the_target(target, near, low, high):
    assert low <= KNOWN.chance(target, near) <= high


# --- CLIP on Wheels -----------------------------------------------------------------------------------------------


def test_cow_goes_to_the_nearest_whatever_it_hides():
    found = [frontier(3.0, 0.9, n_cells=90), frontier(2.0, 0.1, n_cells=8), frontier(2.5)]
    assert chosen_of(cow.rate(context_of(found), found)) is found[1]
    assert cow.rate(context_of([]), []) == []


# --- ESC ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("likely", "near", "adds"),
    [
        (1.0, 1.0, 1.0),
        (0.0, 1.0, -1.0),
        (0.5, 1.0, 0.0),
        (0.8, 0.5, 0.3),
        (0.1, 0.5, -0.4),
        (0.6, 0.5, 0.1),
        (0.7, 0.0, 0.0),
    ],
)
def test_soft_constraints(likely, near, adds):
    assert esc.constraint(likely, near) == pytest.approx(adds)


@pytest.mark.parametrize(("way_m", "shortness"), [(0.5, 1.0), (1.6, 1.0), (6.6, 0.5), (11.6, 0.0), (50.0, 0.0)])
def test_shortness(way_m, shortness):
    assert esc.shortness(way_m) == pytest.approx(shortness)


@pytest.mark.parametrize(
    ("target", "things", "x_m"),
    [
        ("toilet", [], 0.0),  # the shorter way
        ("toilet", [thing("sink", 11.0, 0.0)], 10.0),  # an object and its room
        ("toilet", [thing("sink", 12.5, 0.0)], 10.0),  # the room alone
        ("toilet", [thing("sink", 13.5, 0.0)], 0.0),  # too far away to be of the room
        ("toilet", [thing("sink", 11.0, 0.0, "rejected")], 0.0),
        ("toilet", [thing("bed", 1.0, 0.0)], 10.0),  # what speaks against the near one
        ("zebra", [thing("bed", 1.0, 0.0)], 0.0),  # nothing is known of zebras
    ],
)
def test_esc_weighs_what_is_near_against_the_way(target, things, x_m):
    found = [frontier(2.0, x_m=0.0), frontier(4.0, x_m=10.0)]
    scored = esc.scored_frontiers(found, things, target, KNOWN)
    assert max(scored, key=lambda f: f.score).x_m == x_m


def test_esc_leaves_out_what_is_too_near():
    found = [frontier(1.5), frontier(9.0)]
    assert [f.travel_time_m for f in esc.scored_frontiers(found, [], "toilet", KNOWN)] == [9.0]
    assert len(esc.scored_frontiers(found[:1], [], "toilet", KNOWN)) == 1


def test_esc_keeps_its_goal_until_it_is_explored():
    found = [frontier(2.0, x_m=0.0), frontier(4.0, x_m=10.0)]
    assert chosen_of(esc.rate(context_of(found), found)).x_m == 0.0
    assert chosen_of(esc.rate(context_of(found, heading_for=(10.2, 0.0)), found)).x_m == 10.0


# --- on maps ------------------------------------------------------------------------------------------------------


def first_choice(search, home, name, value):
    """Frontiers weighed and the one chosen, after the scan at the start."""
    goals = home.goals("bed")
    run = search(home, POLICIES[name], goals, home.start(goals, seed=3), value=value)
    while run.step():
        run.known.clear()  # nothing is ever recognised
        weighed = [c for c in run.last.candidates if c.kind == "frontier"]
        if len(weighed) > 1:
            return weighed, next(c for c in weighed if c.chosen)
    raise AssertionError("never two frontiers")


def test_values_lead_vlfm_and_not_frontier(flat, search):
    """The same maps with values that grow towards +x, and towards -x."""
    by_rule = {}
    for name in ("vlfm", "frontier"):
        for sign in (1.0, -1.0):
            weighed, chosen = first_choice(search, flat, name, lambda x, y, s=sign: 0.5 + 0.03 * s * x)
            by_rule[name, sign] = chosen.x_m
            assert chosen.utility == max(c.utility for c in weighed)
    assert by_rule["vlfm", 1.0] > by_rule["vlfm", -1.0]
    assert by_rule["frontier", 1.0] == by_rule["frontier", -1.0]


def test_apexnav_exploits_only_what_differs(flat, search):
    """Weak values: as the nearest-frontier rule; strong ones: towards them."""
    _, weak = first_choice(search, flat, "apexnav", lambda x, y: 0.5 + 1e-4 * x)
    _, nearest = first_choice(search, flat, "frontier", lambda x, y: 0.5 + 1e-4 * x)
    assert (weak.x_m, weak.y_m) == (nearest.x_m, nearest.y_m)
    assert weak.note.startswith("nearest")
    chosen = {}
    for sign in (1.0, -1.0):
        _, strong = first_choice(search, flat, "apexnav", lambda x, y, s=sign: np.clip(0.5 + 0.08 * s * (x - 5), 0, 1))
        chosen[sign] = strong.x_m
    assert chosen[1.0] > chosen[-1.0]


# --- perfect frontiers --------------------------------------------------------------------------------------------


class Field:
    """A goal at the origin, on open ground but for a pillar around (5, 5)."""

    def at(self, p, floor):
        return math.inf if math.dist(p[:2], (5.0, 5.0)) < 0.5 else math.hypot(p[0], p[1])


def perfect(reachable=True):
    field = Field() if reachable else SimpleNamespace(at=lambda p, floor: math.inf)
    navigation = SimpleNamespace(snap=lambda p, floor, within_m: (5.0, 4.5, 0.0))
    return PerfectFrontierRule(Truth(SimpleNamespace(field=field), navigation))


CONTEXT = SimpleNamespace(config=PlannerConfig(), robot=SimpleNamespace(floor="0"))


@pytest.mark.parametrize(
    ("found", "chosen"),
    [
        ([frontier(1.0, x_m=9.0), frontier(6.0, x_m=2.0)], 1),  # 10 m over the nearest, 8 m over the other
        ([frontier(1.0, x_m=6.0), frontier(6.0, x_m=2.0)], 0),
        ([frontier(3.0, x_m=5.0, y_m=5.0), frontier(2.5, x_m=8.0)], 0),  # in the pillar: 0.5 m and 6.7 m from beside it
        ([frontier(3.0, x_m=5.0, y_m=5.0), frontier(2.0, x_m=8.0)], 1),
    ],
)
def test_perfect_frontiers_go_where_the_whole_way_to_a_goal_is_shortest(found, chosen):
    rated = perfect()(CONTEXT, found)
    assert [r.frontier for r in rated] == found
    assert [r.utility > 0.0 for r in rated] == [i == chosen for i in range(len(found))]
    config = CONTEXT.config
    assert rated[chosen].utility == config.explore_chance / (found[chosen].travel_time_m + config.explore_cost_m)


def test_perfect_frontiers_without_any_way_to_a_goal_are_ours(monkeypatch):
    monkeypatch.setattr(perfect_frontiers, "rule_of", lambda config: lambda context, found: ("ours", found))
    assert perfect(reachable=False)(CONTEXT, [frontier(1.0)]) == ("ours", [frontier(1.0)])
    assert perfect()(CONTEXT, []) == ("ours", [])


def test_perfect_frontiers_need_the_truth():
    with pytest.raises(ValueError, match=r"need Task\.truth"):
        POLICIES["perfect-frontiers"].begin(Task("bed", 0, 10, None))
