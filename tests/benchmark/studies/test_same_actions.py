"""The running system beside the benchmark: what is compared, and what is said of it."""

from __future__ import annotations

import pytest

from benchmark.studies.same_actions import Played, compared, page

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


def test_the_page_says_how_many_are_the_same_with_the_running_systems_timing():
    found = compared(ROW | {"actions": list("FFS")}, Played(list("FLS"), True, 0.5))
    in_time = [found._replace(in_time=value) for value in (True, False, None, True)]
    said = page(in_time, "the command")
    assert "**Where their views come when they came in the running system, 2 of 3 are the same.**" in said
    assert [line.rpartition("| ")[2] for line in said.splitlines() if "the first 1" in line] == [
        "all |", "not all |", " |", "all |",
    ]  # fmt: skip
