"""The fit finds what it was made of; views are kept and read again; detections go to what they show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

from surveilnav.benchmark.dataset.splits import SPLITS, SplitSpec
from surveilnav.benchmark.studies.calibration import views
from surveilnav.benchmark.studies.calibration.fit import (
    _rare_dropped,
    both_above,
    fit,
    fit_luck,
    fit_probit,
    matched,
)
from surveilnav.benchmark.studies.calibration.haze import _shown
from surveilnav.benchmark.studies.calibration.page import Side, compare
from surveilnav.benchmark.studies.calibration.run import main, presence_of
from surveilnav.benchmark.studies.calibration.tour import Tour, views_on
from surveilnav.benchmark.studies.calibration.views import MeasuredDetection, OutcomeTable
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.truth import error_model
from surveilnav.simulator.truth.backends import Simulated
from surveilnav.simulator.truth.error_model import FEATURES, SIGHTS, Draws, Luck
from surveilnav.simulator.truth.visible import VisibleThing
from surveilnav.simulator.world.labels import TARGETS


@pytest.fixture(scope="module")
def flat() -> tuple[views.MeasuredViews, SimulatedBuilding]:
    """A parametric flat, seen by a detector that errs more than the committed model: mistakes to fit to."""
    building = SimulatedBuilding(SimulationSettings(building="parametric_flat", seed=1, cameras=1, lighting="flat"))
    seen = views_on(building, Simulated(seed=3, harder=1.0), Tour(40, np.radians(60.0), 1.0))
    return views.measured_views_of("flat", seen, building), building


def test_looks_are_read_as_they_were_written(
    flat: tuple[views.MeasuredViews, SimulatedBuilding], tmp_path: Path
) -> None:
    looks, _ = flat
    path = tmp_path / "flat.looks"
    views.save(looks, path)
    kept = views.load(path)
    assert kept is not None
    assert (kept.name, kept.labels, kept.views) == (looks.name, looks.labels, looks.views)
    path.write_bytes(path.read_bytes()[:-50])
    assert views.load(path) is None, "a damaged file is measured again"
    truth, depth_m = looks.views[0].truth(looks.labels)
    assert truth.ids.shape == depth_m.shape == (640, 640), "camera views at half their resolution"


def test_every_detection_of_a_thing_becomes_one_row(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    looks, _ = flat
    rows = views.rows_of([looks])
    things = rows["thing"]
    assert set(things.labels) <= set(looks.labels.values())
    assert 0.15 < things.found.mean() < 0.9
    assert (things.score[things.found] >= 0.25).all()
    assert things.x.shape == (len(things.ids), len(FEATURES))
    assert np.isfinite(things.x).all()
    said = sum(len(look.found) for look in looks.views)
    assert 0.8 * said <= sum(r.found.sum() for r in rows.values()) <= said


def test_a_model_fitted_to_the_simulated_detector_is_like_it(
    flat: tuple[views.MeasuredViews, SimulatedBuilding],
) -> None:
    looks, _ = flat
    presence = presence_of([looks])
    model = fit(views.rows_of([looks]), presence, "a test")
    real, again = Side.real([looks]), Side.simulated([looks], {"flat": model}, 0)
    keep = np.ones(len(real.rows["thing"].ids), bool)
    assert again.named(keep) == pytest.approx(real.named(keep), abs=0.12)
    page = compare(real, [again], model, "One flat.")
    assert "a test" in page
    assert page.count("\n| ") > 15
    _says_what_is_called_what(page, real)
    _says_it_by_distance(page, real)


def _says_what_is_called_what(page: str, real: Side) -> None:
    """Counted word by word."""
    chairs = [
        name for name, label in zip(real.rows["thing"].name, real.rows["thing"].labels, strict=True) if label == "chair"
    ]
    line = next(x for x in page.splitlines() if x.startswith(f"| chair | {len(chairs)} | ") and x.count("/") == 8)
    shares = [float(cell.split("/")[0]) for cell in line.split("|")[3:-1]]
    assert shares[2] == pytest.approx(100 * chairs.count("chair") / len(chairs), abs=0.06)
    assert shares[-1] == pytest.approx(100 * chairs.count("") / len(chairs), abs=0.06)
    assert sum(shares) == pytest.approx(100, abs=0.4)


def _says_it_by_distance(page: str, real: Side) -> None:
    near = [
        (kind, label, name)
        for kind, rows in real.rows.items()
        for label, name, range_m in zip(rows.labels, rows.name, rows.range_m, strict=True)
        if 2.0 <= range_m < 3.0
    ]
    targets = [(label, name) for kind, label, name in near if kind == "thing" and label in TARGETS]
    others = [name for kind, label, name in near if kind != "thing" or label not in TARGETS]
    named = sum(label == name for label, name in targets) / len(targets)
    false = sum(name in TARGETS for name in others) / len(others)
    line = next(x for x in page.splitlines() if x.startswith("| 2 to 3 |"))
    cells = [float(c) for c in line.split("|")[2:-1]]
    assert (cells[0], cells[3]) == (len(targets), len(others))
    assert (cells[1], cells[4]) == pytest.approx((named, false), abs=6e-4)


def test_names_come_out_as_measured(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    """False alarms that a model calls something else every second time they are seen again, and so less often what was
    measured: both are moved towards what was measured."""
    looks, _ = flat
    measured = views.rows_of([looks])
    model = fit(measured, presence_of([looks]), "a test")
    wrong = np.flatnonzero(measured["other"].found)
    rows = measured["other"].where(np.tile(wrong, 20))
    common = max(set(rows.name.tolist()), key=rows.name.tolist().count)
    at = rows.sight[rows.name.tolist().index(common)]
    never = next(name for name in model.kinds["other"].names[at][""] if name != common)
    rows = replace(rows, name=np.where(rows.name == never, common, rows.name))
    every_second = (rows.name == common) & (np.arange(len(rows.name)) // len(wrong) % 2 == 0)
    measured["other"] = rows
    drawn = measured | {"other": replace(rows, name=np.where(every_second, never, rows.name))}
    before, after = model.kinds["other"], matched(model, measured, drawn).kinds["other"]
    assert after.name_kept > before.name_kept
    was, is_ = before.names[at][""], after.names[at][""]
    assert sum(is_.values()) == pytest.approx(1.0, abs=1e-3)
    gain = {name: is_[name] / share for name, share in was.items()}
    assert gain[common] > 1.1
    assert gain[never] < 0.5 * min(g for name, g in gain.items() if name != never), "what was never measured goes"
    same = matched(model, measured, measured).kinds["other"]
    assert same.name_kept == before.name_kept
    assert same.names[at][""][common] == pytest.approx(was[common], abs=1e-3)


@pytest.mark.parametrize("of", ["other", "thing"])
def test_finds_come_as_often_as_measured(flat: tuple[views.MeasuredViews, SimulatedBuilding], of: str) -> None:
    """Half of what is found in robots' views doesn't come out: as much more is drawn; cameras find as much."""
    looks, _ = flat
    measured = views.rows_of([looks])
    model = fit(measured, presence_of([looks]), "a test")
    n = len(measured[of].ids)
    measured[of] = rows = measured[of].where(np.tile(np.arange(n), 20))
    camera = rows.x[:, FEATURES.index("camera")] > 0
    lost = rows.found & ~camera & (np.cumsum(rows.found) % 2 == 0)
    drawn = measured | {of: replace(rows, name=np.where(lost, "", rows.name))}
    before, after = model.kinds[of], matched(model, measured, drawn).kinds[of]
    found = [float(ndtr(kind.ease(rows.x, rows.labels))[~camera].sum()) for kind in (before, after)]
    should = rows.found[~camera].sum() / (rows.found & ~lost)[~camera].sum()
    assert 1 + (should - 1) / 4 < found[1] / found[0] < 1.1 * should, "one round of some"
    of_cameras = [kind.ease(rows.x, rows.labels)[camera] for kind in (before, after)]
    assert of_cameras[1] == pytest.approx(of_cameras[0], abs=0.01)
    same = matched(model, measured, measured).kinds[of]
    assert (same.weights, same.own) == (before.weights, before.own)


def test_own_names_come_as_often_as_measured(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    looks, _ = flat
    measured = views.rows_of([looks])
    model = fit(measured, presence_of([looks]), "a test")
    n = len(measured["thing"].ids)
    measured["thing"] = rows = measured["thing"].where(np.tile(np.arange(n), 20))
    every_third = rows.right & (np.cumsum(rows.right) % 3 == 0)
    drawn = measured | {"thing": replace(rows, name=np.where(every_third, "vase", rows.name))}
    before, after = model.kinds["thing"], matched(model, measured, drawn).kinds["thing"]
    assert after.weights == before.weights, "as much is found"
    own = [ndtr(kind.own_ease(rows.x, rows.labels))[rows.found].mean() for kind in (before, after)]
    assert own[1] > 1.05 * own[0]


def test_a_kind_that_is_never_wrong_still_has_names(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    looks, _ = flat
    rows = views.rows_of([looks])
    rows["place"] = replace(rows["place"], name=np.full(len(rows["place"].name), ""))
    kind = fit(rows, presence_of([looks]), "a test").kinds["place"]
    assert set(kind.names) == set(SIGHTS)
    assert kind.called("chair", "camera 0.0", np.full(80, 0.5))
    assert kind.score(np.array([-1.0, -0.01]), right=False).tolist() == [0.0, 0.0], "what isn't found has no score"


def test_what_was_never_measured_stays_as_fitted(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    """Names of a sight with no mistake measured are those of its kind of view; with none at all they don't move."""
    looks, _ = flat
    measured = views.rows_of([looks])
    model = fit(measured, presence_of([looks]), "a test")
    drawn = dict(measured)
    measured["other"] = replace(drawn["other"], name=np.full(len(drawn["other"].name), ""))
    assert matched(model, measured, drawn).kinds["other"].names == model.kinds["other"].names
    rows = drawn["other"].where(np.tile(np.arange(len(drawn["other"].ids)), 20))
    at = rows.sight[0]
    name, *_ = before = model.kinds["other"].names[at][""]
    called = np.where(np.arange(len(rows.ids)) % 3 == 0, name, "")
    drawn["other"] = replace(rows, name=called)
    measured["other"] = replace(rows, name=np.where(rows.sight == at, "", called))
    assert measured["other"].found.any()
    assert matched(model, measured, drawn).kinds["other"].names[at][""] == pytest.approx(before, rel=0.05)


def test_places_are_called_alike_near_and_far(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    """Whichever piece of wall a false box's middle lies on: a place has no size that says what it may be taken for."""
    looks, _ = flat
    rows = views.rows_of([looks])
    assert rows["place"].found.any()
    model = fit(rows, presence_of([looks]), "a test")
    names = model.kinds["place"].names
    for view in ("robot", "camera"):
        first, *others = [of for at, of in names.items() if at.startswith(view)]
        assert all(of == first for of in others)


def test_weak_scores_go_by_what_shows(flat: tuple[views.MeasuredViews, SimulatedBuilding]) -> None:
    looks, _ = flat
    rows = views.rows_of([looks])
    shows = {
        label: np.isin(np.arange(len(looks.views)), rows["thing"].view[rows["thing"].labels == label])
        for label in TARGETS
    }
    by, at = min(shows.items(), key=lambda pair: abs(pair[1].mean() - 0.4))
    assert 0.1 < at.mean() < 0.9
    presence = np.zeros((len(looks.views), len(COCO)), np.float32)
    presence[:, COCO.index("umbrella")] = np.where(at, 0.3, 0.1) + 0.05 * np.random.default_rng(0).random(len(at))
    haze = fit(rows, presence, "a test").haze
    assert list(haze) == ["umbrella"], "nothing else is ever weakly seen"
    of = haze["umbrella"]
    assert max(of.beside, key=lambda label: of.beside[label]) == by
    assert of.more({by: 1.0}, camera=False) > 0 > of.more({}, camera=False)
    assert of.luck < 1.0
    assert of.quantiles[0] == pytest.approx(0.1, abs=0.01)
    assert of.quantiles[-1] == pytest.approx(0.35, abs=0.01)


def test_a_single_known_wrong_name_stays_the_commonest() -> None:
    assert list(_rare_dropped({"bed": 0.9, "tv": 0.001}, "couch").items()) == [("bed", 0.9), ("chair", 0.01)]


def test_a_detection_goes_to_the_thing_that_it_fits_or_shows() -> None:
    ids = np.zeros((1, 1), np.uint16)
    bed = VisibleThing(1, "bed", (0.0, 0.0, 100.0, 100.0), ids, 9000, 9000, 2.0)
    chair = VisibleThing(2, "chair", (200.0, 0.0, 240.0, 40.0), ids, 900, 900, 2.0)
    fits = MeasuredDetection("couch", 0.5, (5.0, 0.0, 100.0, 95.0), 2, 0.9, 2.0)
    shows = MeasuredDetection("chair", 0.5, (150.0, 0.0, 240.0, 90.0), 2, 0.6, 2.0)
    neither = MeasuredDetection("chair", 0.5, (300.0, 0.0, 340.0, 90.0), 2, 0.3, 2.0)
    assert views.owners_of([bed, chair], [fits, shows, neither]) == [bed, chair, None]
    assert views.owners_of([], [fits]) == [None]


def test_probit_finds_the_weights_and_shrinks_small_classes() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(6000, len(FEATURES)))
    x[:, 0] = 1.0
    labels = np.array(["bed"] * 5997 + ["tv"] * 3)
    true = np.array([0.3, 0.8, -0.3, -0.5, 0.4, 0.0, 0.2, -0.2, 0.1])
    weights = fit_probit(x, labels, x @ true + rng.normal(size=6000) > 0)
    assert weights["bed"] == pytest.approx(true, abs=0.08)
    assert weights["tv"] == pytest.approx(weights[""], abs=0.6)


def test_shares_of_luck_are_found_from_pairs_of_views() -> None:
    rng = np.random.default_rng(1)
    n, each = 400, 14
    ids = np.repeat(np.arange(n, dtype=np.uint64), each)
    angle = rng.uniform(0, 2 * np.pi, n * each)
    direction = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    range_m = np.exp(rng.uniform(0, 1.5, n * each))
    true = Luck(0.25, 0.45, 0.5, 2.0)
    lucks = np.zeros(n * each)
    for view in range(each):  # the k-th row of every instance is seen in view k
        at = slice(view, None, each)
        lucks[at] = Draws(1, view + 2, ids[at], direction[at], range_m[at]).luck(true, 0)
    text = np.array(["x"] * len(ids))
    zero = np.zeros(len(ids))
    rows = OutcomeTable("thing", text, ids, zero, direction, range_m, zero, zero.astype(int), text, zero, zero, zero)
    fitted = fit_luck(rows, zero, lucks > 0, rng)
    assert fitted.instance == pytest.approx(true.instance, abs=0.1)
    assert fitted.instance + fitted.field == pytest.approx(0.7, abs=0.12)
    assert fitted.angle_rad == pytest.approx(true.angle_rad, rel=0.4)


def test_two_normals_at_once() -> None:
    a, b = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -0.5])
    r = np.array([0.0, 0.5, 0.8])
    drawn = np.random.default_rng(0).multivariate_normal([0, 0], [[1, 0.8], [0.8, 1]], 200_000)
    expected = [0.25, 1 / 3, float(((drawn[:, 0] < 1) & (drawn[:, 1] < -0.5)).mean())]
    assert both_above(a, b, r) == pytest.approx(expected, abs=0.004)


def test_too_few_buildings_are_refused_in_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--buildings", "studio"]) == 2
    assert "at least 3 buildings" in capsys.readouterr().err


def test_the_model_in_use_is_compared_on_a_split_and_left_as_it_is(
    flat: tuple[views.MeasuredViews, SimulatedBuilding], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr("surveilnav.benchmark.studies.calibration.run.OUT", tmp_path)
    monkeypatch.setattr("surveilnav.benchmark.studies.calibration.run.MODEL", tmp_path / "model.json")
    monkeypatch.setattr(
        "surveilnav.benchmark.studies.calibration.run.measured",
        lambda scene, n, backend: asked.append(scene.scene) or flat[0],
    )
    monkeypatch.setattr(
        "surveilnav.benchmark.studies.calibration.run.fitted", lambda *_: pytest.fail("something was fitted")
    )
    monkeypatch.setitem(SPLITS, "val_mini", SplitSpec("val_mini", SPLITS["val_mini"].scenes[:2], 10))
    assert main(["--split", "val_mini"]) == 0
    assert asked == ["studio-s0", "1_bedroom-s0"]
    page = (tmp_path / "val_mini" / "README.md").read_text()
    assert "The model in use" in page
    assert error_model.error_model().source in page
    assert (tmp_path / "val_mini" / "reliability.png").exists()
    assert not (tmp_path / "model.json").exists()


def test_what_shows_in_a_view_is_what_simulated_thinks_shows(
    flat: tuple[views.MeasuredViews, SimulatedBuilding],
) -> None:
    """The haze is fitted to the same rule that it is later drawn by."""
    rows = views.rows_of([flat[0]])
    n_views = len(flat[0].views)
    labels, shown, camera = _shown(rows, n_views)
    assert "" not in labels
    assert camera.tolist() == [float(look.is_camera) for look in flat[0].views]
    for view in range(n_views):
        drawn: dict[str, float] = {}
        for kind in ("thing", "other"):
            there = rows[kind].where(rows[kind].view == view)
            drawn |= error_model.showing(there.labels.tolist(), there.x)
        drawn.pop("", None)
        assert {label: v for label, v in zip(labels, shown[view].tolist(), strict=True) if v} == drawn
    assert 0 < np.count_nonzero(shown) < shown.size
