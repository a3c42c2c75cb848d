"""The bound: nearly the shortest way, over stairs too, never a collision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surveilnav.benchmark.policies import POLICIES
from surveilnav.errors import TargetError
from surveilnav.simulator.world.goals import Goals, Start
from surveilnav.simulator.world.navigation import NavigationMap

SHORTEST_PATH = POLICIES["shortest-path"]


def start_on(navigation: NavigationMap, goals: Goals, floor: str, seed: int) -> Start:
    """A place indoors on ``floor`` from which a goal can be reached, drawn by ``seed``."""
    f = navigation.floors[floor]
    ground = navigation.robot_area[floor] & np.isfinite(goals.field.distance_m[floor]) & f.indoor
    cells = np.argwhere(ground)
    rng = np.random.default_rng([seed, *goals.label.encode(), *floor.encode()])
    x, y = (float(v) for v in f.grid.centres_of(cells[rng.integers(len(cells))]))
    return Start((x, y, f.z_m), floor, float(rng.uniform(-np.pi, np.pi)), goals.field.at((x, y), floor))


@pytest.mark.parametrize("seed", range(2))
def test_spl(house, search, seed):
    spl = []
    for target in ("bed", "couch", "chair", "toilet", "tv", "potted plant"):
        try:
            goals = house.goals(target)
        except TargetError:
            continue
        run = search(house, SHORTEST_PATH, goals, house.start(goals, seed=seed))
        verdict = run.run()
        assert verdict.success, (target, run.last.message)
        assert run.searcher.steps == run.state.steps
        spl.append(verdict.spl)
    assert len(spl) >= 5
    assert sum(spl) / len(spl) >= 0.9, spl


@pytest.mark.parametrize(("below", "seed"), [("0", 0), ("1", 1)])
def test_over_the_stairs(house, search, below, seed):
    goals = house.goals("bed")
    only = {below: goals.viewpoints[below]}
    goals = replace(goals, viewpoints=only, field=house.navigation.distance_field(only))
    start = start_on(house.navigation, goals, "1" if below == "0" else "0", seed)
    run = search(house, SHORTEST_PATH, goals, start)
    verdict = run.run()
    assert verdict.success
    assert "take_stairs" in run.actions
    assert verdict.spl >= 0.9
    assert run.searcher.steps == run.state.steps


def test_it_never_bumps_and_counts_its_steps(house, search):
    goals = house.goals("toilet")
    run = search(house, SHORTEST_PATH, goals, house.start(goals, seed=5), max_steps=4)
    while run.step():
        assert not run.state.collided
    assert (run.last.error, run.searcher.steps) == ("out_of_steps", 4)


def test_it_gets_out_of_corners(flat, search):
    """From many places, some where the step that comes nearest leads nowhere."""
    goals = flat.goals("toilet")
    for seed in range(12):
        start = flat.start(goals, seed=seed)
        verdict = search(flat, SHORTEST_PATH, goals, start).run()
        assert verdict.success
        assert verdict.spl >= 0.8


def test_unreachable_goals_are_said_to_be(house, search):
    goals = house.goals("bed")
    start = house.start(goals)
    nowhere = replace(goals, field=house.navigation.distance_field({}))
    run = search(house, SHORTEST_PATH, nowhere, start)
    assert not run.step()
    assert run.last.error == "unreachable"
