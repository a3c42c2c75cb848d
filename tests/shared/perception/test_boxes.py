"""Suppression and agreement of boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.perception.boxes import Boxes, merge_overlapping, overlaps, weighted_box_fusion
from surveilnav.perception.detectors.coco import quarters
from surveilnav.perception.vocabulary import COCO


def boxes(*rows: tuple[tuple[float, float, float, float], dict[str, float]]) -> Boxes:
    scores = np.zeros((len(rows), len(COCO)), np.float32)
    for i, (_, named) in enumerate(rows):
        for name, score in named.items():
            scores[i, COCO.index(name)] = score
    return Boxes(np.array([r[0] for r in rows], np.float32).reshape(-1, 4), scores, COCO)


def literal_iou(a: np.ndarray, b: np.ndarray) -> float:
    w = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    h = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    return w * h / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - w * h)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_overlaps_against_a_literal_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 50, (7, 2))
    b = np.concatenate([corners, corners + rng.uniform(1, 40, (7, 2))], axis=1).astype(np.float32)
    iou, inside = overlaps(b[:3], b[3:])
    for i in range(3):
        for j in range(4):
            assert iou[i, j] == pytest.approx(literal_iou(b[i], b[3 + j]), abs=1e-5)
    assert np.all(inside >= iou - 1e-6)
    assert np.all(inside <= 1 + 1e-5)


def test_one_thing_with_two_names_is_one_box_that_keeps_both_scores() -> None:
    found = merge_overlapping(
        boxes(((0, 0, 100, 100), {"bed": 0.6}), ((2, 2, 101, 99), {"couch": 0.5}), ((200, 0, 260, 50), {"tv": 0.4})),
        0.6,
    )
    assert len(found) == 2
    assert found.scores[0, COCO.index("bed")] == pytest.approx(0.6)
    assert found.scores[0, COCO.index("couch")] == pytest.approx(0.5)


def test_pieces_that_tiles_cut_go_into_the_whole_but_a_cushion_stays() -> None:
    cut = boxes(
        ((0, 0, 200, 100), {"couch": 0.8}), ((0, 0, 90, 100), {"couch": 0.4}), ((20, 20, 60, 60), {"teddy bear": 0.5})
    )
    assert sorted(COCO[i] for i in merge_overlapping(cut, 0.6, inside=0.8).scores.argmax(axis=1)) == [
        "couch",
        "teddy bear",
    ]
    assert len(merge_overlapping(cut, 0.6)) == 3, "without tiles a small box in a large one is another thing"


@pytest.mark.parametrize(("alone", "expected"), [(0.0, 0.3), (0.5, 0.45), (1.0, 0.6)])
def test_agreement_raises_and_silence_lowers(alone: float, expected: float) -> None:
    both = weighted_box_fusion(
        [boxes(((0, 0, 100, 100), {"tv": 0.6})), boxes(((5, 0, 105, 100), {"tv": 0.5}))], 0.5, alone
    )
    assert len(both) == 1
    assert both.best_scores[0] == pytest.approx(0.55)
    assert 0 < both.xyxy[0, 0] < 5
    single = weighted_box_fusion([boxes(((0, 0, 100, 100), {"tv": 0.6})), Boxes.empty(COCO)], 0.5, alone)
    assert single.best_scores[0] == pytest.approx(expected)


def test_detectors_that_contradict_each_other_lower_both_classes() -> None:
    one = weighted_box_fusion(
        [boxes(((0, 0, 100, 100), {"bed": 0.6})), boxes(((0, 0, 100, 100), {"couch": 0.5}))], 0.5, 0.3
    )
    assert len(one) == 1
    assert one.best_scores[0] == pytest.approx(0.3)
    assert COCO[int(one.scores[0].argmax())] == "bed"


def test_nothing_found_by_anybody() -> None:
    assert len(weighted_box_fusion([Boxes.empty(COCO), Boxes.empty(COCO)], 0.5, 0.3)) == 0
    assert len(merge_overlapping(Boxes.empty(COCO), 0.5)) == 0
    assert len(Boxes.concatenate([Boxes.empty(COCO), Boxes.empty(COCO)])) == 0


def test_clipping_drops_slivers() -> None:
    found = boxes(((-10, -10, 20, 20), {"bed": 0.5}), ((98, 0, 150, 50), {"bed": 0.5})).clipped(100, 100)
    np.testing.assert_array_equal(found.xyxy, [[0, 0, 20, 20]])


@settings(max_examples=30, deadline=None)
@given(st.integers(300, 2000), st.integers(300, 2000), st.floats(0, 0.5))
def test_quarters_cover_the_picture(width: int, height: int, overlap: float) -> None:
    covered = np.zeros((height, width), np.uint8)
    for x0, y0, x1, y1 in quarters(width, height, overlap):
        assert 0 <= x0 < x1 <= width
        assert 0 <= y0 < y1 <= height
        covered[y0:y1, x0:x1] = 1
    assert covered[::7, ::7].all()
    assert covered[height // 2].all()
    assert covered[:, width // 2].all()
