"""oracle says what is there; simulated errs as often as its table says, and the same way every time."""

from __future__ import annotations

import json

import numpy as np
import pytest

from surveilnav.categories import COCO
from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception.truth import Oracle, Simulated, error_model, visible_things
from surveilnav.sensing.views import TrueInstances, box_cells

CAMERA = Pinhole.from_hfov(160, 120, 1.3)
RGB = np.zeros((120, 160, 3), np.uint8)


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
        ("couch", 1.0, (10.0, 20.0, 110.0, 100.0)), ("tv", 1.0, (40.0, 40.0, 50.0, 60.0)),
    ], "lamps aren't COCO's, ten pixels of bed are too few"  # fmt: skip
    couch = seen.detections[0]
    assert couch.mask is not None
    assert couch.mask.sum() == 100 * 80 - 20 * 10
    assert Oracle.needs_truth
    assert seen.image_embedding @ Oracle().embed_texts(["tv"])[0] > 0.6


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


@pytest.mark.parametrize(("range_m", "row"), [(1.0, 0), (2.0, 1), (4.0, 2), (6.0, 3)])
def test_simulated_misses_as_often_as_its_table_says(range_m: float, row: int) -> None:
    errors = error_model()
    depth, truth = scene(range_m)
    only = TrueInstances(np.where(truth.ids == 7, truth.ids, 0).astype(np.uint16), {7: "potted plant"})
    col = int(np.searchsorted(errors["side_edges_px"], np.sqrt((only.ids == 7).sum())))
    n = 400
    hits = 0
    for i in range(n):
        seen = Simulated().perceive(RGB, depth, CAMERA, truth=only, key=(i,))
        hits += any(
            abs(d.box_px[0] - 10) < 20 and abs(d.box_px[2] - 110) < 20 and d.mask is not None for d in seen.detections
        )
    assert hits / n == pytest.approx(errors["recall"][row][col], abs=0.08)


def test_simulated_sees_things_that_are_not_there_as_often_as_its_table_says() -> None:
    nothing = TrueInstances(np.zeros((120, 160), np.uint16), {})
    depth = np.ones((120, 160), np.float32)
    seen = [Simulated().perceive(RGB, depth, CAMERA, truth=nothing, key=(i,)).detections for i in range(500)]
    assert sum(len(d) for d in seen) / 500 == pytest.approx(error_model()["false_positives"]["per_view"], rel=0.25)


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


def test_the_error_table_is_complete_and_says_where_it_comes_from() -> None:
    errors = error_model()
    assert errors["source"]
    recall = np.array(errors["recall"])
    assert recall.shape == (len(errors["range_edges_m"]) + 1, len(errors["side_edges_px"]) + 1)
    assert ((recall >= 0) & (recall < 1)).all(), "an error model that never misses isn't one"
    named = {
        *errors["confusions"],
        *errors["false_positives"]["labels"],
        *(k for v in errors["confusions"].values() for k in v),
    }
    assert named <= set(COCO)
    json.dumps(errors)


def test_things_without_depth_are_not_visible() -> None:
    depth, truth = scene()
    depth[:, :80] = 0
    things = visible_things(truth, depth, 60)
    assert [t.label for t in things] == ["couch"]
    assert things[0].range_m == 1.0
