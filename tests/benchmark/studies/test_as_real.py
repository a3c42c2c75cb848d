"""The study of real wiring: what it makes of rows, and how it follows a robot's truth."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from surveilnav.benchmark.studies.as_real import Truth, page


def odometry(x_m: float, y_m: float, yaw_rad: float, floor: str = "1") -> SimpleNamespace:
    orientation = SimpleNamespace(z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2))
    pose = SimpleNamespace(position=SimpleNamespace(x=x_m, y=y_m), orientation=orientation)
    header = SimpleNamespace(frame_id=f"building/{floor}")
    return SimpleNamespace(data=SimpleNamespace(header=header, pose=SimpleNamespace(pose=pose)))


def row(wiring: str, building: str = "a", **facts: object) -> dict:
    known = {
        "building": building,
        "seed": 0,
        "target": "tv",
        "wiring": wiring,
        "success": True,
        "spl": 0.5,
        "found": True,
    }
    known |= {
        "path_m": 10.0,
        "shortest_path_m": 5.0,
        "search_s": 20.0,
        "steps": 90,
        "message": "found",
        "program": "abc",
    }
    return known | facts


def test_a_robots_way_is_added_up_and_its_pose_is_the_newest() -> None:
    truth = Truth()
    for x_m, y_m, yaw_rad in [(1.0, 1.0, 0.0), (4.0, 5.0, 1.0), (4.0, 5.0, -2.0), (4.0, 4.0, -2.0)]:
        truth.on_odometry(odometry(x_m, y_m, yaw_rad))  # type: ignore[arg-type]
    assert truth.pose == pytest.approx((4.0, 4.0, -2.0))
    assert (truth.path_m, truth.floor) == (pytest.approx(6.0), "1")


def test_the_page_compares_what_was_played_both_ways() -> None:
    rows = [
        row("as-real", spl=0.4),
        row("simulated", spl=0.8),
        row("as-real", "b", success=False, spl=0.0, message="out of steps", found=False),
        row("simulated", "b"),
        row("as-real", "c"),
        row("as-real", "d", skipped="no tv"),
    ]
    said = page(rows, "the command")
    assert "2 starts in 2 buildings" in said
    assert "success changes by -50.0" in said
    assert "SPL by -45.0" in said
    assert "| as real | 1 of 2 | 20.0 | 1 |" in said
    assert "| b | 0 | tv | no / yes | 10.0 / 10.0 | 5.0 | 20 / 20 | out of steps |" in said
    assert "- d, seed 0, tv, as-real: no tv" in said
    assert "Nothing was played both ways" in page(rows[4:], "c")
