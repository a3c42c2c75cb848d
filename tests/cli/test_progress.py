"""Progress where nobody sees a bar: lines, with the time that is left."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from surveilnav.cli import progress


@pytest.fixture
def clock(monkeypatch):
    """``clock[0]``: the time [s]."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=80)


def test_each_kind_of_work_has_a_line_and_a_time_of_its_own(clock, console):
    with progress.bar(console) as moved:
        moved(0.0, "baking light")
        clock[0] += 20
        moved(0.5, "baking light")
        moved(0.51, "baking light")
        moved(0.0, "rendering camera views (c0-1)")
        clock[0] += 15
        moved(0.25, "rendering camera views (c0-2)")
    assert console.file.getvalue().splitlines() == [
        "  baking light ...",
        "  baking light: 50 %, 20 s left",
        "  rendering camera views ...",
        "  rendering camera views (c0-2): 25 %, 45 s left",
    ]


def test_counted_work_says_how_many_are_left(clock, console):
    with progress.counting(console, "scenes") as counted:
        counted(1, 4, "a")
        clock[0] += 60
        counted(2, 4, "b")
        counted(3, 4, "c")
        counted(4, 4, "d")
    assert console.file.getvalue().splitlines() == ["  2 of 4 scenes, 2 min 0 s left b", "  4 of 4 scenes d"]


def test_a_bar_begins_anew_with_another_kind_of_work(clock):
    terminal = Console(file=io.StringIO(), width=80, force_terminal=True)
    with progress.bar(terminal) as moved:
        moved(1.0, "baking light")
        moved(0.1, "rendering camera views (c0-1)")
    assert "rendering camera views" in terminal.file.getvalue()
