"""The running system beside the benchmark: what is compared, and what is said of it."""

from __future__ import annotations

from functools import partial

import pytest

from surveilnav.benchmark.play.cameras import InvokedCameras
from surveilnav.benchmark.play.sight import Sight
from surveilnav.benchmark.studies import same_actions
from surveilnav.benchmark.studies.arrivals import Arrivals, MapsState
from surveilnav.benchmark.studies.same_actions import Played, compared, page, play_and_compare, played
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings

ROW = {
    "building": "a",
    "seed": 0,
    "target": "tv",
    "surveillance": "on",
    "perception": "oracle",
    "success": True,
    "found": True,
    "spl": 0.5,
}


@pytest.mark.parametrize(
    ("live", "alone", "same", "whole", "then"),
    [
        ("FFS", "FFS", 3, True, "–"),
        ("FFS", "FLS", 1, False, "F"),
        ("FF", "FFS", 2, False, "–"),
        ("FFS", "FF", 2, False, "S"),
        ("", "F", 0, False, "–"),
    ],
)
def test_first_actions_that_are_the_same(live: str, alone: str, same: int, whole: bool, then: str):
    found = compared(ROW | {"actions": list(live)}, Played(list(alone), True, 0.5))
    assert (found.same, found.whole, found.next_live) == (same, whole, then)


def test_a_mission_that_failed_halts_the_robot_and_that_is_no_difference():
    found = compared(ROW | {"found": False, "actions": ["F", "F", "stop"]}, Played(list("FF"), False, 0.0))
    assert (found.whole, found.live) == (True, 2)
    found = compared(ROW | {"actions": ["F", "F", "stop"]}, Played(list("FF"), False, 0.0))
    assert not found.whole


def test_the_page_counts_whole_searches_and_what_came_of_them():
    others = [Played(list("FFS"), True, 0.5), Played(list("FLS"), False, 0.0)]
    found = [compared(ROW | {"actions": list("FFS")}, alone) for alone in others]
    off = compared(ROW | {"actions": list("FS"), "surveillance": "off"}, Played(list("FS"), True, 0.25))
    said = page([found[0], off, found[1]], "the command")
    assert "to the last action: without cameras 1 of 1, with them 1 of 2** (8 actions" in said
    assert "| oracle | off | 1 | 1 | 1 | 1 / 1 | 50.0 / 25.0 |" in said
    assert "| oracle | on | 2 | 1 | 1 | 2 / 1 | 50.0 / 25.0 |" in said
    assert "| 3 / 3 | yes / yes | all |  |" in said
    assert "| 3 / 3 | yes / no | the first 1 | F / L |" in said


def test_the_page_says_how_many_are_the_same_with_live_timing():
    other = compared(ROW | {"actions": list("FFS")}, Played(list("FLS"), True, 0.5))
    same = compared(ROW | {"actions": list("FFS")}, Played(list("FFS"), True, 0.5))
    said = page([other._replace(with_live_timing=again) for again in (same, other, None, same)], "the command")
    assert "**With live timing 2 of 3 are the same**" in said
    assert [line.rpartition(" | ")[2] for line in said.splitlines() if "| FF" not in line and "F / L" in line] == [
        "all |",
        "the first 1 |",
        " |",
        "all |",
    ]
    assert "With live timing" not in page([other], "the command")


def test_with_live_timing_a_search_is_the_recorded_one(monkeypatch):
    """With what its own maps had taken at each decision a search is the same; with views that never come it is another."""
    monkeypatch.setattr(same_actions, "Sight", partial(Sight, way="depth"))  # the same search in a tenth of the time
    building = SimulatedBuilding(SimulationSettings(building="parametric_flat", cameras=2))
    row = ROW | {"target": "toilet", "seed": 1}
    alone = played(row, building)
    views, decided_on = [], {}
    real = InvokedCameras.in_turn

    def noted(cameras, joint, seen, arrived):
        for view in real(cameras, joint, seen, arrived):
            views.append((view.view.source, view.view.view))
            yield view
        decided_on[seen.view.seq] = MapsState(joint.revision, cameras.n_pending)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(InvokedCameras, "in_turn", noted)
        assert played(row, building) == alone
    n_views = sum(source.startswith("camera/") for source, _ in views)
    assert n_views > 10
    row |= {"actions": alone.actions, "arrivals": Arrivals(tuple(views), decided_on).to_row()}
    found = play_and_compare(row, building)
    assert found.whole
    assert found.with_live_timing.whole
    late = Arrivals(tuple(v for v in views if v[0] == "robot/r1"), dict.fromkeys(decided_on, MapsState(0, n_views)))
    assert not play_and_compare(row | {"arrivals": late.to_row()}, building).with_live_timing.whole
