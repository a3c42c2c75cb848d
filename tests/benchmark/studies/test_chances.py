"""The fit of chances: finds the terms that made its data, and is judged as the literature judges."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from surveilnav.benchmark.dataset.splits import SceneSpec
from surveilnav.benchmark.studies.calibration import chances, run
from surveilnav.benchmark.studies.calibration.chances import (
    Judged,
    chances_of,
    expected_error,
    fit,
    judged,
    left_out,
    page,
)
from surveilnav.benchmark.studies.calibration.tour import Tour, views_on
from surveilnav.benchmark.studies.calibration.views import MeasuredViews, measured_views_of, save
from surveilnav.perception.chances import ChanceTable, features
from surveilnav.perception.detectors.compact import CompactNetwork
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.single_network import SingleNetworkBackend
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.truth.backends import Oracle
from tests.compact_file import write


def made(n: int, seed: int = 0) -> Judged:
    rng = np.random.default_rng(seed)
    score, size, far = rng.uniform(0.25, 0.95, n), np.exp(rng.normal(-1.6, 0.5, n)), rng.uniform(0.5, 6.0, n)
    x = features(score, size, far, rng.random(n) < 0.3)
    label = rng.choice(["bed", "chair", "rare"], n, p=[0.3, 0.695, 0.005])
    even = np.where(label == "bed", -2.0, 0.0)
    logit = even + x @ np.array([1.5, 0.6, 0.0, -0.8, -0.5])
    return Judged(rng.integers(0, 6, n), label, x, score, rng.random(n) < 1 / (1 + np.exp(-logit)), np.ones(n))


def test_it_finds_the_terms_that_made_the_data():
    table = fit(made(20_000), "a test")
    bed, chair = table.by_class["bed"], table.by_class["chair"]
    assert bed.intercept - chair.intercept == pytest.approx(-2.0, abs=0.2)
    assert table.slope + chair.slope == pytest.approx(1.5, abs=0.15)
    assert (table.size, table.range, table.camera) == pytest.approx((0.6, -0.8, -0.5), abs=0.12)
    rows = made(20_000, seed=1)
    ours, raw = (expected_error(p, rows.right, rows.weight) for p in (chances_of(table, rows), rows.score))
    assert ours < 0.02 < raw


def test_a_class_with_few_detections_goes_with_all():
    rows = made(2_000)
    table = fit(rows)
    assert "rare" not in table.by_class


def test_the_expected_error_is_that_of_the_literature():
    chance = np.array([0.05, 0.3, 0.35, 0.9])
    right = np.array([False, True, False, True])
    literal = 1 / 4 * abs(0.05 - 0) + 2 / 4 * abs(0.325 - 0.5) + 1 / 4 * abs(0.9 - 1)
    assert expected_error(chance, right, np.ones(4)) == pytest.approx(literal)
    twice = expected_error(chance[[0, 1, 1, 2, 3]], right[[0, 1, 1, 2, 3]], np.array([1.0, 0.5, 0.5, 1.0, 1.0]))
    assert twice == pytest.approx(literal), "half a weight each: as if it were one"


def test_what_is_seen_often_counts_once():
    """Ninety detections of ten right things, and one of each of thirty wrong ones: a quarter of the things is right."""
    n = 120
    x = features(np.full(n, 0.5), np.full(n, 0.2), np.full(n, 3.0), np.zeros(n, bool))
    right = np.arange(n) < 90
    rows = Judged(np.zeros(n, np.int64), np.full(n, "tv"), x, np.full(n, 0.5), right, np.where(right, 1.0 / 9, 1.0))
    assert chances_of(fit(rows), rows) == pytest.approx(np.full(n, 0.25), abs=0.02)


def test_each_building_is_judged_by_others_and_the_page_says_how_well():
    rows = made(3_000)
    chance = left_out(rows)
    mine = fit(rows.where(rows.building % 5 != 2))
    assert chance[rows.building == 2] == pytest.approx(chances_of(mine, rows.where(rows.building == 2)))
    text = page(rows, chance, fit(rows, "made up"))
    assert "Source: made up." in text
    assert "| targets, camera views |" in text


#: What the network below calls a chest of drawers.
OTHERS = dict.fromkeys(("chair", "rug", "bookcase", "cabinet"), "chest of drawers")


@pytest.fixture(scope="module")
def colours(tmp_path_factory):
    """A flat in flat light as a tiny network sees it, for which what is dark is a chest of drawers."""
    building = SimulatedBuilding(SimulationSettings(building="parametric_flat", seed=1, cameras=1, lighting="flat"))
    path = write(tmp_path_factory.mktemp("compact") / "compact.onnx", blackness=2.0, more={"meanings": OTHERS})
    backend = SingleNetworkBackend(
        "compact", "in a test", CompactNetwork(open_session(path, Runtime()), 320), "compact@0"
    )
    seen = views_on(building, backend, Tour(12, np.radians(90.0), 2.0))
    return backend, measured_views_of("flat", seen, building, backend.vocabulary), building


def test_views_are_judged_in_the_words_of_another_vocabulary(colours):
    _, looks, building = colours
    truth = building.scene.truth_labels
    chests = {id_ for id_, label in truth.items() if label in OTHERS}
    assert {id_ for id_, label in looks.labels.items() if label == "chest of drawers"} == chests != set()
    assert looks.labels.items() >= {(i, label) for i, label in truth.items() if label in ("bed", "tv", "toilet")}
    assert all(look.presence == [] for look in looks.views)
    rows = judged([looks])
    assert len(rows.right) == sum(len(look.found) for look in looks.views) > 0
    assert 0 < rows.right.mean() < 1, "some of what it calls a chest of drawers is one"


def test_a_table_is_written_for_any_backend_with_a_vocabulary(colours, tmp_path, monkeypatch, capsys):
    backend, looks, _ = colours
    asked = []
    monkeypatch.setattr(chances, "choose_backend", lambda name: asked.append(name) or backend)
    monkeypatch.setattr(chances, "measured", lambda scene, n_views, by: looks if by is backend else None)
    monkeypatch.setattr(chances, "DATA", tmp_path)
    monkeypatch.setattr(chances, "OUT", tmp_path)
    assert chances.main(["--backend", "compact"]) == 0
    table = msgspec.json.decode((tmp_path / "chances" / "compact.json").read_bytes(), type=ChanceTable)
    assert (asked, "detections of compact@0" in table.source) == (["compact"], True)
    assert "chances --backend compact`" in (tmp_path / "chances_compact.md").read_text()
    empty = MeasuredViews("flat", {}, [msgspec.structs.replace(look, found=[]) for look in looks.views])
    monkeypatch.setattr(chances, "measured", lambda scene, n_views, by: empty)
    assert chances.main(["--backend", "compact"]) == 2
    assert "found nothing" in capsys.readouterr().err
    monkeypatch.setattr(chances, "choose_backend", lambda name: Oracle())
    assert chances.main(["--backend", "oracle"]) == 2
    assert "has a vocabulary, and oracle is none" in capsys.readouterr().err


def test_looks_are_kept_by_the_weights_that_looked(colours, tmp_path, monkeypatch):
    backend, looks, _ = colours
    monkeypatch.setattr(run, "DATA", tmp_path)
    (tmp_path / "compact@0").mkdir()
    save(looks, tmp_path / "compact@0" / "flat-s0-all-9.looks")
    kept = run.measured(SceneSpec("flat", 0, "all"), 9, backend)
    assert (kept.name, kept.labels, len(kept.views)) == (looks.name, looks.labels, len(looks.views))
