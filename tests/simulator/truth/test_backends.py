"""oracle says what is there; simulated errs as often as its model says, and the same way every time."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace as structs_replace
from scipy.special import ndtr

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception.embedders import class_space
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import DetectedObject, TrueInstances, ViewPerception, box_cells
from surveilnav.simulator.truth.backends import Oracle, PerfectDetector, Simulated
from surveilnav.simulator.truth.error_model import FEATURES, SIGHTS, Haze, error_model, features
from surveilnav.simulator.truth.visible import candidates, visible_things
from surveilnav.simulator.world.labels import TARGETS

CAMERA = Pinhole.from_hfov(160, 120, 1.3)
RGB = np.zeros((120, 160, 3), np.uint8)
_LEVEL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]], np.float64)


def scene(range_m: float = 1.0) -> tuple[np.ndarray, TrueInstances]:
    ids = np.zeros((120, 160), np.uint16)
    ids[20:100, 10:110] = 7
    ids[40:60, 40:50] = 9  # stands before 7
    ids[0:5, 0:160] = 3
    ids[110:112, 150:155] = 4
    return np.full((120, 160), range_m, np.float32), TrueInstances(ids, {7: "sofa", 9: "tv", 3: "lamp", 4: "bed"})


def test_oracle_says_what_is_there() -> None:
    depth, truth = scene()
    seen = Oracle().perceive(RGB, depth, CAMERA, truth=truth)
    assert [(d.label, d.score, d.box_px) for d in seen.detections] == [
        ("couch", 1.0, (10.0, 20.0, 110.0, 100.0)),
        ("tv", 1.0, (40.0, 40.0, 50.0, 60.0)),
    ], "lamps aren't COCO's, ten pixels of bed are too few"
    couch = seen.detections[0]
    assert couch.mask is not None
    assert couch.mask.sum() == 100 * 80 - 20 * 10
    assert Oracle.needs_truth
    assert seen.image_embedding @ Oracle().embed_texts(["tv"])[0] > 0.6


def test_oracle_knows_any_word_that_it_is_asked_for() -> None:
    depth, truth = scene()
    truth = TrueInstances(truth.ids, {**truth.labels, 9: "samovar"})
    oracle = Oracle()
    unasked, asked = (oracle.perceive(RGB, depth, CAMERA, truth=truth, prompts=p) for p in ((), ("Samovar", "tray")))
    assert [d.label for d in unasked.detections] == ["couch"]
    assert [d.label for d in asked.detections] == ["couch", "samovar"]
    samovar, tray, bed = oracle.embed_texts(["seems like there is a samovar", "tray", "bed"])
    assert asked.detections[1].embedding @ samovar > 0.9
    assert abs(asked.detections[1].embedding @ tray) < 0.5
    assert asked.image_embedding @ samovar > unasked.image_embedding @ samovar + 0.4
    assert unasked.image_embedding @ bed == pytest.approx(
        class_space.embed_image([np.eye(80)[COCO.index("couch")]]) @ class_space.embed_texts(["bed"])[0], abs=1e-6
    ), "COCO's classes are as alike as they were"


@pytest.mark.parametrize("backend", [Oracle(), Simulated()])
def test_without_instance_ids_there_is_no_answer(backend: Oracle | Simulated) -> None:
    depth, truth = scene()
    with pytest.raises(PerceptionError, match="instance ids"):
        backend.perceive(RGB, depth, CAMERA)
    with pytest.raises(PerceptionError, match="fit"):
        backend.perceive(RGB, depth, CAMERA, truth=TrueInstances(truth.ids[:50], truth.labels))


def test_simulated_depends_on_seed_and_key_alone() -> None:
    depth, truth = scene()

    def answer(seed: int, key: tuple) -> list:
        seen = Simulated(seed=seed).perceive(RGB, depth, CAMERA, truth=truth, key=key)
        return [(d.label, d.score, d.box_px) for d in seen.detections]

    keys = [("robot/a", 0, n) for n in range(30)]
    first = [answer(1, key) for key in keys]
    assert first == [answer(1, key) for key in keys]
    assert first != [answer(2, key) for key in keys]
    assert len({str(a) for a in first}) > 10


def one(label: str, scale: int = 1, range_m: float = 1.6, n: int = 7) -> tuple[np.ndarray, TrueInstances, Pinhole]:
    """A thing in the middle of a view before a wall, at a resolution."""
    ids = np.zeros((60 * scale, 80 * scale), np.uint16)
    ids[22 * scale : 38 * scale, 30 * scale : 50 * scale] = n
    depth = np.where(ids > 0, range_m, 3.0).astype(np.float32)
    return depth, TrueInstances(ids, {n: label}), Pinhole.from_hfov(80 * scale, 60 * scale, 1.3)


def hits(backend: Simulated, label: str, views: int, scale: int = 2, pose: np.ndarray | None = None) -> np.ndarray:
    """Whether a thing was found under its name, by building (rows) and view (columns)."""
    depth, truth, camera = one(label, scale)
    out = np.zeros((400 // views, views), bool)
    for building in range(len(out)):
        told = TrueInstances(truth.ids, {**truth.labels, 1000 + building: "box"}, pose)
        for view in range(views):
            seen = backend.perceive(RGB, depth, camera, truth=told, key=("robot/r1", 0, view))
            out[building, view] = any(d.label == label and abs(d.box_px[0] / scale - 30) < 8 for d in seen.detections)
    return out


@pytest.mark.parametrize("label", ["bed", "chair", "toilet", "tv"])
def test_simulated_finds_as_often_as_its_model_says(label: str) -> None:
    model = error_model()
    depth, truth, camera = one(label, 2)
    things = next(c for c in candidates(truth, depth, camera, False, model.min_size_rad) if c.kind == "thing")
    kind = model.kinds["thing"]
    expected = float(ndtr(kind.ease(things.x, [label])[0]) * ndtr(kind.own_ease(things.x, [label])[0]))
    assert hits(Simulated(), label, 1).mean() == pytest.approx(expected, abs=0.09)


def test_simulated_sees_the_same_at_any_resolution() -> None:
    coarse, fine = (hits(Simulated(), "couch", 2, scale=scale) for scale in (4, 8))
    assert (coarse == fine).mean() > 0.95
    assert 0.1 < fine.mean() < 0.95


def test_near_large_plain_things_are_found_oftener_than_far_small_hidden_ones() -> None:
    kind = error_model().kinds["thing"]
    for label in TARGETS:
        near = features(*(np.array([v]) for v in (0.3, 2.0, 0.05, 0.0, 0.3)), False)
        far = features(*(np.array([v]) for v in (0.05, 5.0, 0.6, 1.0, 0.1)), False)
        assert kind.ease(near, [label])[0] > kind.ease(far, [label])[0] + 1.0
        assert kind.score(np.array([0.5]), True) < kind.score(np.array([2.0]), True)


def test_a_harder_world_hides_things_and_gives_false_alarms() -> None:
    found = [hits(Simulated(harder=harder), "chair", 1).mean() for harder in (0.0, 1.5)]
    assert found[0] > found[1] + 0.2
    depth, truth, camera = one("", 2)
    alarms = []
    for harder in (-1.0, 1.0):
        told = [TrueInstances(truth.ids, {1000 + b: "box"}, _LEVEL) for b in range(100)]
        views = [Simulated(harder=harder).perceive(RGB, depth, camera, truth=t, key=("robot/r1", 0, 1)) for t in told]
        alarms.append(sum(len(v.detections) for v in views))
    assert alarms[1] > 3 * alarms[0] + 10


def test_false_alarms_stay_with_the_thing_that_caused_them() -> None:
    alike = []
    for building in range(250):
        depth, truth, camera = one("", 2)
        told = TrueInstances(truth.ids, {1000 + building: "box"}, _LEVEL)
        worse = Simulated(harder=1.0)
        two = [worse.perceive(RGB, depth, camera, truth=told, key=("robot/r1", 0, n)).detections for n in (1, 2)]
        alike.append([{d.label for d in seen} for seen in two])
    either = [(a, b) for a, b in alike if a or b]
    assert 100 < len(either) < 230
    assert np.mean([bool(a & b) for a, b in either]) > 0.28, "0.19 if views had nothing in common"


def test_a_false_alarm_is_called_nothing_that_its_size_cannot_be() -> None:
    """A lamp of 0.3 m is no bed; one of 1.8 m may be one, and is no toilet."""
    names: dict[float, set[str]] = {}
    for range_m in (0.8, 4.8):
        depth, truth, camera = one("lamp", 2, range_m)
        depth = np.where(truth.ids > 0, range_m, range_m + 2.0).astype(np.float32)
        names[range_m] = set()
        for n in range(150):
            told = TrueInstances(truth.ids, {**truth.labels, 1000 + n: "box"})
            seen = Simulated(harder=2.0).perceive(RGB, depth, camera, truth=told, key=("robot/a", 0, n))
            on_lamp = [d for d in seen.detections if np.abs(np.array(d.box_px) - (60, 44, 100, 76)).max() < 16]
            names[range_m] |= {d.label for d in on_lamp}
    assert not names[0.8] & {"bed", "couch"}
    assert names[0.8] & {"toilet", "potted plant", "chair"}
    assert names[4.8] & {"bed", "couch"}
    assert "toilet" not in names[4.8]


def test_what_fits_no_name_is_no_false_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    depth, truth, camera = one("lamp", 2)
    monkeypatch.setattr("surveilnav.simulator.truth.backends._fits", lambda *of: False)
    for n in range(60):
        told = TrueInstances(truth.ids, {**truth.labels, 1000 + n: "box"})
        assert not Simulated(harder=2.0).perceive(RGB, depth, camera, truth=told, key=("robot/a", 0, n)).detections


def test_simulated_boxes_and_masks_stay_in_the_picture() -> None:
    depth, truth = scene()
    for i in range(200):
        for d in Simulated().perceive(RGB, depth, CAMERA, truth=truth, key=(i,)).detections:
            x0, y0, x1, y1 = box_cells(d.box_px, 160, 120)
            assert x0 < x1
            assert y0 < y1
            assert d.box_px[2] <= 160
            assert d.mask is None or d.mask.shape == (y1 - y0, x1 - x0)
            assert 0 <= d.score <= 1


def test_the_error_model_is_complete_and_says_where_it_comes_from() -> None:
    model = error_model()
    assert "surveilnav.benchmark.studies.calibration" in model.source
    assert set(model.kinds) == {"thing", "other", "place"}
    for kind in model.kinds.values():
        assert {len(row) for row in [*kind.weights.values(), *kind.own.values()]} == {len(FEATURES)}
        assert set(kind.names) == set(SIGHTS)
        shares = [shares for of_class in kind.names.values() for shares in of_class.values()]
        assert {name for of_one in shares for name in of_one} | set(model.haze) <= set(COCO)
        assert [sum(of_one.values()) for of_one in shares] == pytest.approx([1.0] * len(shares), abs=0.02)
        assert all(share > 0 for of_one in shares for share in of_one.values())
        assert set(kind.boxes) - {"right", "wrong"} <= set(COCO)
        assert 0 <= kind.luck.instance + kind.luck.field < 1, "every view has some luck of its own"
        assert all(np.diff([ease for ease, _ in knots]).min() > 0 for knots in kind.scores.values())


@pytest.mark.parametrize(("beside", "more"), [({"cabinet": 2.0}, True), ({"lamp": 2.0}, False)])
def test_a_class_seems_to_be_where_its_haze_is_thicker(beside: dict[str, float], more: bool) -> None:
    """A real detector's weak scores tell rooms apart: an umbrella seems to stand by what umbrellas stand by."""
    haze = {"umbrella": Haze([0.0, 0.05, 0.1, 0.4], beside, 0.0, 0.2, 0.5)}
    backend = Simulated(model=structs_replace(error_model(), haze=haze))
    ids = np.zeros((120, 160), np.uint16)
    ids[20:100, 10:110] = 7

    def presence(labels: dict[int, str], key: int) -> float:
        truth = TrueInstances(ids, labels, _LEVEL)
        image = backend.perceive(
            RGB, np.full((120, 160), 1.5, np.float32), CAMERA, truth=truth, key=(key,)
        ).image_embedding
        return float(class_space.presence(image)[COCO.index("umbrella")])

    with_it, without = (
        np.mean([presence(labels, key) for key in range(40)]) for labels in ({7: "cabinet"}, {7: "desk"})
    )
    assert bool(with_it > without + 0.05) == more


def test_doors_and_windows_are_mistaken_less_often_than_furniture() -> None:
    weights = error_model().kinds["other"].weights
    assert weights[""][0] > weights["window"][0] + 0.5
    assert weights[""][0] > weights["door"][0] + 0.5


@pytest.mark.parametrize(("label", "kind"), [("door", "other"), ("window", "other"), ("", "place"), ("wall", "place")])
def test_what_has_no_name_and_looks_large_is_a_wall_but_a_large_door_is_a_door(label: str, kind: str) -> None:
    ids = np.zeros((120, 160), np.uint16)
    ids[10:110, 40:120] = 5
    truth = TrueInstances(ids, {5: label} if label else {}, _LEVEL)
    shown = candidates(truth, np.full((120, 160), 4.0, np.float32), CAMERA, False, 0.02)
    things = [t.number for c in shown if c.kind != "place" for t in c.shown]
    assert things == ([5] if kind == "other" else [])


@pytest.mark.parametrize("kept", [0.0, 1.0])
def test_a_wrong_name_is_the_instance_s_own_or_the_view_s(kept: float) -> None:
    """A detector that always finds and never knows: with names that are kept, a thing has one from everywhere."""
    rgb, (depth, truth) = RGB, scene()
    model = error_model()
    known = model.kinds["thing"]
    sure, never = [9.0, *[0.0] * 8], [-9.0, *[0.0] * 8]
    names = {sight: {"": dict.fromkeys(("vase", "book", "oven", "clock"), 0.25)} for sight in SIGHTS}
    kind = structs_replace(known, weights={"": sure}, own={"": never}, names=names, name_kept=kept)
    backend = Simulated(model=structs_replace(model, kinds={**model.kinds, "thing": kind}))
    said = [
        [
            d.label
            for d in backend.perceive(rgb, depth, CAMERA, truth=truth, key=(i,)).detections
            if d.label in names["robot 0.0"][""]
        ]
        for i in range(30)
    ]
    assert all(said), "found in every view"
    assert len({tuple(sorted(labels)) for labels in said}) == 1 if kept else len({labels[0] for labels in said}) > 2


def test_things_without_depth_are_not_visible() -> None:
    depth, truth = scene()
    depth[:, :80] = 0
    things = visible_things(truth, depth, 60, {"bed", "chair", "tv", "couch", "toilet", "potted plant"})
    assert [t.label for t in things] == ["couch"]
    assert things[0].range_m == 1.0


class Looks(Oracle):
    """Sees the picture in its own way: it takes the couch for a bed, misses the tv, and has embeddings of three numbers."""

    name, embedding_dim, vocabulary, needs_truth = "looks", 3, COCO, False

    def embed_texts(self, texts):
        return np.array([[0.0, 0.0, 1.0] for _ in texts], np.float32)

    def _look(self, batch):
        for task in batch:
            assert task.truth is None, "only what says things is told the truth"
            bed = DetectedObject("bed", 0.4, (12.0, 20.0, 110.0, 96.0), None, np.array([1, 0, 0], np.float32))
            image = np.array([0, 1, 0], np.float32)
            task.result = ViewPerception(self.name, (bed,), image, "three numbers", ("couch", "bed"))


def test_a_perfect_detector_says_what_is_there_and_the_backend_what_it_looks_like() -> None:
    depth, truth = scene()
    perfect = PerfectDetector(Looks())
    truth = TrueInstances(truth.ids, {**truth.labels, 3: "samovar"})
    seen = perfect.perceive(RGB, depth, CAMERA, truth=truth, prompts=("samovar",))
    told = Oracle().perceive(RGB, depth, CAMERA, truth=truth)
    assert [(d.label, d.score, d.chance, d.box_px) for d in seen.detections] == [
        (d.label, 1.0, 1.0, d.box_px) for d in told.detections
    ], "the backend knows no samovar"
    assert [d.embedding.tolist() for d in seen.detections] == [[1, 0, 0], [0, 0, 1]]
    assert (seen.image_embedding.tolist(), seen.embedding_model) == ([0, 1, 0], "three numbers")
    assert (seen.backend, seen.words) == ("oracle", ("couch", "bed"))
    assert (perfect.needs_truth, perfect.calibrated, perfect.embedding_dim) == (True, True, 3)
