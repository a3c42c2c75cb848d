"""The fit of chances: finds the terms that made its data, and is judged as the literature judges."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.studies.calibration.chances import Judged, chances_of, expected_error, fit, left_out, page
from surveilnav.perception.chances import features


def made(n: int, seed: int = 0) -> Judged:
    rng = np.random.default_rng(seed)
    score, size, far = rng.uniform(0.25, 0.95, n), np.exp(rng.normal(-1.6, 0.5, n)), rng.uniform(0.5, 6.0, n)
    x = features(score, size, far, rng.random(n) < 0.3)
    label = rng.choice(["bed", "chair", "rare"], n, p=[0.3, 0.695, 0.005])
    even = np.where(label == "bed", -2.0, 0.0)
    logit = even + x @ np.array([1.5, 0.6, 0.0, -0.8, -0.5])
    return Judged(rng.integers(0, 6, n), label, x, score, rng.random(n) < 1 / (1 + np.exp(-logit)))


def test_it_finds_the_terms_that_made_the_data():
    table = fit(made(20_000), "a test")
    bed, chair = table.by_class["bed"], table.by_class["chair"]
    assert bed.even - chair.even == pytest.approx(-2.0, abs=0.2)
    assert table.slope + chair.slope == pytest.approx(1.5, abs=0.15)
    assert (table.size, table.range, table.camera) == pytest.approx((0.6, -0.8, -0.5), abs=0.12)
    rows = made(20_000, seed=1)
    assert expected_error(chances_of(table, rows), rows.right) < 0.02 < expected_error(rows.score, rows.right)


def test_a_class_with_few_detections_goes_with_all():
    rows = made(2_000)
    table = fit(rows)
    assert "rare" not in table.by_class
    assert table.base_of("rare") == table.base == pytest.approx(rows.right.mean(), abs=0.01)


def test_the_expected_error_is_that_of_the_literature():
    chance = np.array([0.05, 0.3, 0.35, 0.9])
    right = np.array([False, True, False, True])
    literal = 1 / 4 * abs(0.05 - 0) + 2 / 4 * abs(0.325 - 0.5) + 1 / 4 * abs(0.9 - 1)
    assert expected_error(chance, right) == pytest.approx(literal)


def test_each_building_is_judged_by_others_and_the_page_says_how_well():
    rows = made(3_000)
    chance = left_out(rows)
    mine = fit(rows.where(rows.building % 5 != 2))
    assert chance[rows.building == 2] == pytest.approx(chances_of(mine, rows.where(rows.building == 2)))
    text = page(rows, chance, fit(rows, "made up"))
    assert "Source: made up." in text
    assert "| targets, camera views |" in text
