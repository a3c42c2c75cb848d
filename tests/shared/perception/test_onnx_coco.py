"""onnx-coco: the networks' own formats on the real weights, and the pipeline around them on a made-up detector."""

from __future__ import annotations

import math
import os

import cv2
import numpy as np
import pytest

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.coco import CocoDetector, load
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.pipeline import PipelineBackend
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.depth_in_box import DepthInBox
from surveilnav.perception.sizes import extents_of
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.truth.choose import choose_backend

needs_models = pytest.mark.skipif(
    not os.environ.get("SURVEILNAV_MODELS_DIR"), reason="SURVEILNAV_MODELS_DIR names no directory with detector weights"
)
CAMERA = Pinhole.from_hfov(640, 480, math.radians(79))


def stop_sign(width: int, height: int, centre: tuple[int, int], radius: int) -> np.ndarray:
    """The one object of COCO's that is easily drawn: a red octagon with STOP in it, on a grey sky."""
    picture = np.full((height, width, 3), (150, 165, 180), np.uint8)
    cv2.rectangle(
        picture, (centre[0] - radius // 12, centre[1]), (centre[0] + radius // 12, height), (110, 110, 110), -1
    )
    angles = np.pi / 8 + np.arange(8) * np.pi / 4
    for r, colour in ((radius, (255, 255, 255)), (int(0.94 * radius), (190, 20, 30))):
        corners = np.stack([centre[0] + r * np.cos(angles), centre[1] + r * np.sin(angles)], axis=1)
        cv2.fillPoly(picture, [corners.astype(np.int32)], colour)
    scale = radius / 52
    (w, h), _ = cv2.getTextSize("STOP", cv2.FONT_HERSHEY_DUPLEX, scale, max(1, radius // 18))
    at = (centre[0] - w // 2, centre[1] + h // 2)
    cv2.putText(picture, "STOP", at, cv2.FONT_HERSHEY_DUPLEX, scale, (255, 255, 255), max(1, radius // 18), cv2.LINE_AA)
    return cv2.GaussianBlur(picture, (3, 3), 0)


def iou(a: np.ndarray, b: tuple[float, float, float, float]) -> float:
    w = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    h = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    return w * h / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - w * h)


@needs_models
@pytest.mark.models
@pytest.mark.parametrize("name", ["yolox-nano", "deimv2-femto", "deimv2-atto", "picodet-s"])
@pytest.mark.parametrize(("width", "height", "centre"), [(640, 480, (200, 180)), (480, 640, (300, 400))])
def test_every_family_finds_a_stop_sign_in_its_place(
    name: str, width: int, height: int, centre: tuple[int, int]
) -> None:
    backend = choose_backend("onnx-coco", detectors=[name], large_detectors=[name], download=False)
    assert isinstance(backend, PipelineBackend)
    (found,) = backend.detector.detect([stop_sign(width, height, centre, 90)], [()])
    at = COCO.index("stop sign")
    best = int(found.scores[:, at].argmax())
    assert found.scores[best, at] > 0.3
    assert iou(found.xyxy[best], (centre[0] - 84, centre[1] - 84, centre[0] + 84, centre[1] + 84)) > 0.7


@needs_models
@pytest.mark.models
def test_a_whole_view_with_two_detectors() -> None:
    backend = choose_backend("onnx-coco", download=False)
    assert "yolox-nano + picodet-s; for cameras yolox-nano + deimv2-femto" in backend.why
    depth = np.full((480, 640), 4.0, np.float32)
    depth[90:270, 110:290] = 2.0
    seen = backend.perceive(stop_sign(640, 480, (200, 180), 90), depth, CAMERA)
    assert [d.label for d in seen.detections] == ["stop sign"]
    sign = seen.detections[0]
    assert sign.mask is not None
    assert sign.mask.sum() > 0.6 * sign.mask.size
    assert sign.embedding @ backend.embed_texts(["stop sign"])[0] > 0.9
    assert seen.image_embedding @ backend.embed_texts(["seems like there is a stop sign"])[0] > 0.8


class Scripted:
    """Says what it is told, relative to what it is shown: red squares are tvs."""

    name = "scripted"

    def __init__(self) -> None:
        self.shown: list[tuple[int, ...]] = []

    def detect(self, rgb: np.ndarray) -> Boxes:
        self.shown.append(rgb.shape)
        red = ((rgb[..., 0] > 200) & (rgb[..., 1] < 50)).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(red)
        xyxy = [(x, y, x + w, y + h) for x, y, w, h, _ in stats[1:]]
        scores = np.zeros((len(xyxy), len(COCO)), np.float32)
        scores[:, COCO.index("tv")] = 0.8
        return Boxes(np.array(xyxy, np.float32).reshape(-1, 4), scores, COCO)


def scripted(min_score: float) -> PipelineBackend:
    """The backend ``onnx-coco`` around it."""
    parts = CocoDetector([Scripted()]), DepthInBox(), ClassSpace()
    return PipelineBackend("onnx-coco", "", *parts, min_score=min_score, extents_m=extents_of(COCO))


@pytest.mark.parametrize("at", [(100, 100), (600, 600), (500, 900), (1100, 50), (1270, 1270)])
def test_tiles_give_each_thing_once_where_it_is(at: tuple[int, int]) -> None:
    rgb = np.zeros((1280, 1280, 3), np.uint8)
    x, y = at
    rgb[y : y + 120, x : x + 120] = (255, 0, 0)
    detector = Scripted()
    found = CocoDetector([detector]).detect_one(rgb)
    assert len(detector.shown) == 5
    assert len(found) == 1
    np.testing.assert_allclose(found.xyxy[0], (x, y, min(1280, x + 120), min(1280, y + 120)), atol=1)
    assert found.best_scores[0] == pytest.approx(0.8)


def test_pieces_that_tiles_cut_count_less_than_whole_things() -> None:
    class NearSighted(Scripted):
        def detect(self, rgb: np.ndarray) -> Boxes:
            return super().detect(rgb) if rgb.shape[0] < 1280 else Boxes.empty(COCO)

    rgb = np.zeros((1280, 1280, 3), np.uint8)
    rgb[100:220, 20:1260] = (255, 0, 0)
    rgb[800:900, 100:200] = (255, 0, 0)
    found = CocoDetector([NearSighted()]).detect_one(rgb)
    np.testing.assert_allclose(found.best_scores, [0.8, 0.4, 0.4], atol=1e-6)


def test_only_the_first_detector_tiles_large_views() -> None:
    robots, first, second = Scripted(), Scripted(), Scripted()
    CocoDetector([robots], [first, second]).detect_one(np.zeros((1280, 1280, 3), np.uint8))
    assert (len(robots.shown), len(first.shown), len(second.shown)) == (0, 5, 1)


@pytest.mark.parametrize(("range_m", "score"), [(0.1, 0.0), (2.0, 0.8), (20.0, 0.32)])
def test_a_thing_of_impossible_size_counts_less(range_m: float, score: float) -> None:
    """100 pixels are 4 cm, 0.8 m and 8 m of a tv; the first isn't worth an answer even at half the threshold."""
    rgb = np.zeros((480, 640, 3), np.uint8)
    rgb[100:200, 100:200] = (255, 0, 0)
    depth = np.full((480, 640), 3 * range_m, np.float32)
    depth[100:200, 100:200] = range_m
    backend = scripted(0.33 if score == 0.0 else 0.25)
    found = backend.perceive(rgb, depth, Pinhole.from_hfov(640, 480, 1.8)).detections
    assert [d.score for d in found] == ([pytest.approx(score)] if score else [])


def test_small_views_are_looked_at_once() -> None:
    detector = Scripted()
    CocoDetector([detector]).detect_one(np.zeros((480, 640, 3), np.uint8))
    assert detector.shown == [(480, 640, 3)]


def test_weak_boxes_tint_the_image_but_are_not_detections() -> None:
    rgb = np.zeros((480, 640, 3), np.uint8)
    rgb[100:200, 100:200] = (255, 0, 0)
    backend = scripted(0.9)
    seen = backend.perceive(rgb, np.zeros((480, 640), np.float32), CAMERA)
    assert seen.detections == ()
    assert seen.image_embedding @ backend.embed_texts(["tv"])[0] > 0.5


def test_files_that_are_no_network(tmp_path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "x.onnx").write_bytes(b"nonsense")
    with pytest.raises(PerceptionError, match=r"x.onnx"):
        load(tmp_path / "x.onnx", "yolox", Runtime())
    with pytest.raises(PerceptionError, match="family"):
        load(tmp_path / "x.onnx", "yolo-9000", Runtime())
