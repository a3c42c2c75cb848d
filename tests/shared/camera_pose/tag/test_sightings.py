"""The file of sightings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.camera_pose.tag import load_sightings, save_sightings
from surveilnav.errors import ConfigError
from tests.tag_scenes import random_stops, scene_from_poses


def test_what_is_written_is_read(tmp_path: Path) -> None:
    written = scene_from_poses(random_stops(np.random.default_rng(0), 4)).sightings
    written.stops[1].robot = written.stops[1].floor = "1"  # a name that looks like a number
    save_sightings(tmp_path / "s.yaml", written)
    read = load_sightings(tmp_path / "s.yaml")
    assert read.tag == written.tag
    assert [stop.line for stop in read.stops] == [3, 4, 5, 6]
    for a, b in zip(read.stops, written.stops, strict=True):
        assert (a.robot, a.floor) == (b.robot, b.floor)
        assert (a.x_m, a.y_m, a.yaw_rad) == pytest.approx((b.x_m, b.y_m, b.yaw_rad), abs=1e-4)
        assert a.seen["lobby"] == pytest.approx(b.seen["lobby"], abs=1e-3)


def test_a_file_without_stops_is_read(tmp_path: Path) -> None:
    written = scene_from_poses(np.zeros((0, 3))).sightings
    save_sightings(tmp_path / "s.yaml", written)
    assert load_sightings(tmp_path / "s.yaml").stops == []


STOP = "{robot: r1, floor: ground, xy_m: [1, 2], yaw_deg: 0, seen: {lobby: [[1, 2], [3, 4], [5, 6], [7, 8]]}}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a table with tag and stops"),
        (
            "tag: {id: 0, size_m: 0.16, height_m: 0.5}\nstops:\n  - " + STOP.replace(", [7, 8]", ""),
            "line 3: stops.0.seen",
        ),
        (
            "tag: {id: 0, size_m: 0.16, height_m: 0.5}\nstops:\n  - " + STOP.replace("1, 2", ".nan, 2"),
            "line 3: stops.0.xy_m",
        ),
        ("tag: {id: 0, size_m: 16, height_m: 0.5}\nstops: []", "line 1: tag.size_m"),
        ("tag: {id: 900, size_m: 0.16, height_m: 0.5}\nstops: []", "line 1: tag.id"),
        ("tag: {id: 0, size_m: 0.16}\nstops: []", "line 1: tag.height_m"),
        ("tag: [", "isn't YAML"),
    ],
)
def test_a_mistake_is_named_at_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_sightings(tmp_path / "s.yaml")
