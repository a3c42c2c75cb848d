"""Every policy ends, by its own decision or its steps, and does the same again with the same seed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from surveilnav.benchmark.policies import POLICIES, Task, policy_of
from surveilnav.errors import ConfigError
from surveilnav.services.planner.core.motion.drive import FmmPlanner

CHANCE = ("random-walk", "random-samples")


def test_a_wrong_name_is_told_the_right_ones():
    assert policy_of("vlfm") is POLICIES["vlfm"]
    with pytest.raises(
        ConfigError, match=r"'vlfn'.*surveilnav.*random-walk.*frontier.*vlfm.*l3mvn.*apexnav.*shortest-path"
    ):
        policy_of("vlfn")


def test_names_and_lines():
    for name, policy in POLICIES.items():
        assert policy.name == name
        assert "\n" not in policy.about
    for name in ("surveilnav-paper", "frontier", "cow", "vlfm", "l3mvn", "esc", "apexnav"):
        assert "https://" in POLICIES[name].about or "arXiv" in POLICIES[name].about


@pytest.mark.parametrize("name", ["cow", "vlfm", "l3mvn", "esc"])
def test_the_rule_alone_differs_in_belief_only(name):
    """What is believed: one sure detection, or as ours. The maps are the same otherwise."""
    as_written, verified = POLICIES[name].fusion, POLICIES[f"{name}-verified"].fusion
    confirmation = as_written.objects.confirmation
    assert (confirmation.rule, confirmation.paper.min_detections, confirmation.paper.flip_rejects) == (
        "paper",
        1,
        False,
    )
    assert verified.objects == POLICIES["surveilnav"].fusion.objects
    assert (verified.map, verified.value) == (as_written.map, as_written.value)


@pytest.mark.parametrize("name", [name for name in POLICIES if name.endswith("-verified")])
def test_with_our_verification_all_but_the_rule_is_ours(name):
    """Otherwise a table compares more than rules: how objects are weighed against exploring, and when they are believed."""
    task = Task("bed", 0, 500, FmmPlanner())
    rule, ours = POLICIES[name].begin(task), POLICIES["surveilnav"].begin(task)
    assert rule._rule is not ours._rule
    of_rule = {"value_radius_m": ours._config.value_radius_m, "strategy": ours._config.strategy}
    assert rule._config.changed(**of_rule) == ours._config
    assert POLICIES[name].fusion.objects == POLICIES["surveilnav"].fusion.objects


@pytest.mark.parametrize(
    ("goal_on_floor", "planning", "chance"),
    [(True, {}, 1.0), (False, {}, 0.7), (True, {"floor_chance": 0.3}, 0.3)],
)
def test_every_policy_may_know_that_its_floor_has_a_goal(goal_on_floor, planning, chance):
    for name in ("surveilnav", "surveilnav-paper", "frontier", "vlfm", "l3mvn", "apexnav", "random-walk"):
        task = Task("bed", 0, 500, FmmPlanner(), goal_on_floor=goal_on_floor, planning=planning)
        config = POLICIES[name].begin(task)._config
        assert config.floor_chance == chance


@pytest.mark.parametrize("name", [name for name in POLICIES if name != "random-walk" and "-verified" not in name])
def test_it_finds_what_is_there(flat, search, name):
    goals = flat.goals("toilet")
    run = search(flat, POLICIES[name], goals, flat.start(goals))
    verdict = run.run()
    assert verdict.success, run.last.message
    assert run.last.found
    assert run.searcher.steps == run.state.steps


@pytest.mark.parametrize("name", [name for name in POLICIES if name != "shortest-path"])
def test_it_ends_where_there_is_nothing(flat, search, name):
    """The target is never recognised: the steps bound the search, or it ends by itself, and nothing is claimed."""
    goals = flat.goals("toilet")
    run = search(flat, POLICIES[name], replace(goals, label="zebra"), flat.start(goals), max_steps=40)
    run.run()
    assert not run.last.found
    assert run.last.error in ("out_of_steps", "not_found")
    assert run.searcher.steps <= 40


@pytest.mark.parametrize("name", POLICIES)
def test_the_same_seed_gives_the_same_actions(flat, search, name):
    goals = flat.goals("bed")
    start = flat.start(goals)

    def actions(seed):
        run = search(flat, POLICIES[name], goals, start, seed=seed, max_steps=22)
        run.run()
        return run.actions

    first = actions(1)
    assert actions(1) == first
    assert (actions(2) != first) == (name in CHANCE)


def test_the_shortest_path_needs_the_truth():
    with pytest.raises(ValueError, match="truth"):
        POLICIES["shortest-path"].begin(Task("bed", 0, 500, FmmPlanner()))
