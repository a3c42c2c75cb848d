"""Luck is standard normal, as alike from view to view as its shares say, and the same on every machine."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.simulator.truth.error_model import SIGHTS, Draws, Kind, Luck, features, hashed, sights, uniforms

LUCK = Luck(instance=0.2, field=0.5, angle_rad=0.5, range_ratio=2.0)
IDS = np.arange(1, 20_001, dtype=np.uint64)


def luck(view: int = 1, turn_rad: float = 0.0, range_m: float = 2.0, scene: int = 5, channel: int = 0) -> np.ndarray:
    direction = np.tile([np.cos(turn_rad), np.sin(turn_rad), 0.0], (len(IDS), 1))
    return Draws(scene, view, IDS, direction, np.full(len(IDS), range_m)).luck(LUCK, channel)


def test_luck_is_standard_normal() -> None:
    drawn = luck()
    assert drawn.mean() == pytest.approx(0.0, abs=0.03)
    assert drawn.std() == pytest.approx(1.0, abs=0.03)
    assert np.abs(np.quantile(drawn, [0.05, 0.95])) == pytest.approx(1.645, abs=0.06)


@pytest.mark.parametrize(
    ("other", "alike"),
    [
        ({}, 1.0),
        ({"view": 2}, 0.7),
        ({"view": 2, "turn_rad": 0.5}, 0.2 + 0.5 * np.exp(-0.5 * (2 * np.sin(0.25) / 0.5) ** 2)),
        ({"view": 2, "range_m": 4.0}, 0.2 + 0.5 * np.exp(-0.5)),
        ({"view": 2, "turn_rad": np.pi}, 0.2),
        ({"scene": 6}, 0.0),
        ({"channel": 1}, 0.0),
    ],
)
def test_views_share_luck_by_instance_direction_and_distance(other: dict, alike: float) -> None:
    if "scene" in other:
        other = {**other, "view": 2}
    assert np.corrcoef(luck(), luck(**other))[0, 1] == pytest.approx(alike, abs=0.03)


def test_draws_are_the_same_on_every_machine_and_in_any_company() -> None:
    assert hashed(3, ("robot/r1", 0, 7)) == 14413063924098497299
    few = uniforms(9, np.array([5, 7], np.uint64), 2, 3)
    assert few[1].tolist() == uniforms(9, np.array([7], np.uint64), 2, 3)[0].tolist()
    assert few[0].tolist() == pytest.approx([0.267844166451, 0.508923567766, 0.162234882688], abs=1e-9)


def test_names_come_as_often_as_their_shares_and_never_the_thing_s_own() -> None:
    shares = {"": {"bed": 0.5, "chair": 0.3, "tv": 0.2}, "sink": {"vase": 1.0}}
    kind = Kind({}, LUCK, {"robot 0.2": shares, "robot 0.4": {"": {"toilet": 1.0}}}, 0.0, {}, {}, {})
    assert kind.called("sink", "robot 0.2", np.full(80, 0.5)) == ["vase"]
    assert kind.called("sink", "robot 0.4", np.full(80, 0.5)) == ["toilet"]
    lucks = np.random.default_rng(0).random((4000, 80))
    names = [kind.called("chair", "robot 0.2", u) for u in lucks]
    assert {tuple(sorted(all_)) for all_ in names} == {("bed", "tv")}
    assert sum(all_[0] == "bed" for all_ in names) / 4000 == pytest.approx(5 / 7, abs=0.025)


def test_the_same_luck_draws_the_same_name_from_like_shares() -> None:
    """However they are ordered: names keep from band to band as far as their shares do."""
    near, far = {"bed": 0.5, "chair": 0.3, "tv": 0.2}, {"chair": 0.4, "bed": 0.4, "tv": 0.2}
    kind = Kind({}, LUCK, {"robot 0.2": {"": far}, "robot 0.4": {"": near}}, 0.0, {}, {}, {})
    lucks = np.random.default_rng(1).random((4000, 80))
    same = [kind.called("", "robot 0.2", u)[0] == kind.called("", "robot 0.4", u)[0] for u in lucks]
    assert np.mean(same) > 0.8


def test_sights_are_the_kind_of_view_and_how_large_things_show() -> None:
    size_rad = np.array([0.001, 0.19, 0.2, 0.41, 0.59, 0.7, 9.0])  # larger than that of FEATURES: as the largest
    ones, zeros = np.ones(7), np.zeros(7)
    robot, camera = (sights(features(size_rad, ones, zeros, zeros, zeros, c)) for c in (False, True))
    assert robot == [f"robot {low}" for low in (0.0, 0.0, 0.2, 0.4, 0.4, 0.6, 0.6)]
    assert camera == [sight.replace("robot", "camera") for sight in robot]
    assert set(robot + camera) == set(SIGHTS)
