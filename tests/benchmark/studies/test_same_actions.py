"""The running system beside the benchmark: what is compared, and what is said of it."""

from __future__ import annotations

import pytest

from benchmark.studies.same_actions import compared, page

ROW = {"building": "a", "seed": 0, "target": "tv", "surveillance": "on", "perception": "oracle"}


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
    found = compared(ROW | {"actions": list(live)}, list(alone))
    assert (found.same, found.whole, found.next_live) == (same, whole, then)


def test_the_page_counts_whole_searches():
    found = [compared(ROW | {"actions": list("FFS")}, list(alone)) for alone in ("FFS", "FLS")]
    said = page(found, "the command")
    assert "1 of 2 searches are the same to the last action** (6 actions" in said
    assert "| 3 / 3 | all |  |" in said
    assert "| 3 / 3 | the first 1 | F / L |" in said
