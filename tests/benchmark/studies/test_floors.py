"""A search over the stairs, all services' cores composed, and the table of such searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surveilnav.benchmark.studies import floors

RECORD = {
    "building": "house",
    "seed": 0,
    "target": "tv",
    "start": "1",
    "summaries": "with",
    "perception": "onnx-coco",
    "success": True,
    "found": True,
    "reason": "",
    "message": "found tv",
    "steps": 60,
    "path_m": 11.0,
    "shortest_path_m": 10.0,
    "spl": 0.9,
    "floors": ["1", "0"],
    "seen": {"0": 0.78, "1": 0.0},
    "changes": [{"step": 20, "floor": "1", "to_floor": "0", "why": "the cameras of floor 0 saw 'tv' with 0.78"}],
    "summary_bytes": {"c0-1": 100, "c1-1": 80},
    "camera_bytes": 5_000_000,
    "invoked": ["c0-1"],
    "seconds": 9.0,
    "picture": "house-tv-1-with.png",
}
WITHOUT = RECORD | {"summaries": "without", "success": False, "reason": "not_found", "spl": 0.0, "summary_bytes": {}}
APART = WITHOUT | {"picture": "house-tv-1-without.png"}


def test_the_table_puts_both_arms_beside_each_other():
    page = floors.table([RECORD, WITHOUT])
    assert "| with | 1 | 1 | 90.0 | 60 | 11.0 m | 180 | 5.0 |" in page
    assert "| without | 1 | 0 | 0.0 |" in page
    assert "| house | tv | 1 | 0 (0.78) | yes / not_found | 60 / 60 |" in page
    assert "after 20 steps to 0" in page
    assert page.count("![](house-tv-1-with.png)") == 1, "both went the same way"
    apart = floors.table([RECORD, APART])
    assert (
        apart.index("![](house-tv-1-with.png)")
        < apart.index("without summaries:")
        < apart.index("![](house-tv-1-without.png)")
    )


def test_the_same_way_is_drawn_once(tmp_path):
    one, other = np.zeros((9, 9, 3), np.uint8), np.ones((9, 9, 3), np.uint8)
    for arm, image, name in (
        ("with", one, "house-potted_plant-1-with.png"),
        ("without", one, "house-potted_plant-1-with.png"),
        ("without", other, "house-potted_plant-1-without.png"),
    ):
        assert floors.keep_picture(tmp_path, "house-potted plant-1", arm, image) == name
    assert len(list(tmp_path.iterdir())) == 2


@pytest.fixture(scope="module")
def house():
    from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings

    return SimulatedBuilding(SimulationSettings(building="parametric_house", lighting="flat"))


@pytest.fixture(scope="module")
def downstairs(house):
    """Only the tv of the ground floor is looked for; its camera sees that one, and the upper one's doesn't see its."""
    from surveilnav.simulator.world.goals import find_goals

    goals = find_goals(house.scene, house.navigation, "tv", caster=house.caster)
    below = {"0": goals.viewpoints["0"]}
    return replace(goals, viewpoints=below, field=house.navigation.distance_field(below))


def test_starts_are_where_the_target_is_not(house, downstairs):
    assert list(floors.elsewhere(house.navigation, downstairs)) == ["1"]
    starts = [floors.start_on(house.navigation, downstairs, "1", seed) for seed in (0, 0, 1)]
    assert starts[0] == starts[1] != starts[2]
    assert all(s.floor == "1" and np.isfinite(s.shortest_path_m) for s in starts)
    assert all(s.shortest_path_m > house.navigation.transits[0].length_m for s in starts)


@pytest.mark.parametrize("planner", ["fmm", "sp"])
def test_over_the_stairs(house, downstairs, planner):
    """What the ground floor's camera saw sends the robot down; its own cameras follow it; the choice cost few bytes.

    The robot takes it for sure that upstairs has no tv: else it would look there first.
    """
    from surveilnav.benchmark.play.episode import Episode
    from surveilnav.benchmark.play.shortest_path import ShortestPathPlanner
    from surveilnav.benchmark.play.sight import Sight
    from surveilnav.benchmark.policies.mission import Mission
    from surveilnav.benchmark.policies.policy import Task
    from surveilnav.services.planner.core import PlannerConfig
    from surveilnav.services.planner.core.motion.drive import FmmPlanner
    from surveilnav.simulator.truth.choose import choose_backend
    from surveilnav.simulator.world.goals import Start

    driver = ShortestPathPlanner(house.navigation) if planner == "sp" else FmmPlanner()
    mission = Mission(Task("tv", 0, 80, driver), PlannerConfig(floor_chance=0.0), summaries=True)
    head = house.navigation.transits[0].end_on("1")
    at = house.navigation.snap((head[0], head[1] + 0.8, head[2]), "1")
    start = Start(at, "1", -np.pi / 2, downstairs.field.at(at, "1"))
    episode = Episode(Sight(house, choose_backend("oracle")), downstairs, start, mission).run()
    assert episode.floors[:2] == ("1", "0"), episode.message
    assert "saw 'tv' with 1.00" in mission.changes[0].why
    assert sorted(episode.camera_bytes) == ["c0-1", "c1-1"]
    assert sorted(episode.summary_bytes) == ["c0-1", "c1-1"]
    assert all(0 < n <= 600 for n in episode.summary_bytes.values())
    assert episode.verdict.path_m > house.navigation.transits[0].length_m
    image = floors.picture(house, episode)
    assert image.ndim == 3
    assert (image != image[0, 0]).any()
