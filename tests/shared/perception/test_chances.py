"""Chances: rising with the score, within bounds, and as the formula says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole
from surveilnav.perception.backend import Backend, Stage
from surveilnav.perception.chances import ChanceTable, ClassTerms, chance_table, with_chances
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import DetectedObject, ViewPerception

TABLE = ChanceTable(
    source="a test",
    intercept=-1.0,
    slope=1.2,
    size=0.5,
    size_squared=-0.1,
    range=-0.4,
    camera=-0.3,
    by_class={"bed": ClassTerms(intercept=-1.0, slope=-0.2, n=50), "odd": ClassTerms(0.0, -9.0, 1)},
)
share = st.floats(0, 1)


@given(
    label=st.sampled_from(["bed", "tv", "odd"]),
    low=share,
    high=share,
    size=st.floats(0, 3),
    far=st.floats(0, 50),
    camera=st.booleans(),
)
def test_it_rises_with_the_score_and_is_never_certain(label, low, high, size, far, camera):
    low, high = sorted((low, high))
    a, b = (TABLE.chance(label, s, size, far, is_camera=camera) for s in (low, high))
    assert 0.0 < a <= b < 1.0


def test_it_is_what_the_formula_says():
    logit = (
        -1.0
        - 1.0
        + (1.2 - 0.2) * math.log(0.6 / 0.4)
        + 0.5 * math.log(2)
        - 0.1 * math.log(2) ** 2
        - 0.4 * math.log(0.5)
        - 0.3
    )
    assert TABLE.chance("bed", 0.6, 0.4, 1.5, is_camera=True) == pytest.approx(1 / (1 + math.exp(-logit)))
    # a class that it wasn't fitted to, at a range that nobody knows
    logit = -1.0 + 1.2 * math.log(0.6 / 0.4)
    assert TABLE.chance("tv", 0.6, 0.2, 0.0, is_camera=False) == pytest.approx(1 / (1 + math.exp(-logit)))


def test_the_tables_that_there_are():
    table = chance_table("onnx-coco")
    assert table is not None
    assert set(table.by_class) <= set(COCO)
    assert {"bed", "chair", "couch", "toilet", "tv", "potted plant"} <= set(table.by_class)
    assert table.slope > 0
    assert chance_table("eyes") is None


def seen_by(table_, is_camera):
    mask = np.zeros((20, 10), bool)
    mask[5:10] = True
    depth_m = np.full((48, 64), 9.0, np.float32)
    depth_m[15:20, 20:30] = 2.5  # what the mask covers
    camera = Pinhole.from_hfov(64, 48, 1.2)
    vector = np.array([1.0, 0.0], np.float32)
    found = (
        DetectedObject("bed", 0.6, (20.0, 10.0, 30.0, 30.0), mask, vector),
        DetectedObject("tv", 0.5, (0.0, 0.0, 8.0, 8.0), None, vector),
    )
    return camera, with_chances(ViewPerception("b", found, vector), depth_m, camera, table_, is_camera=is_camera)


def test_each_detection_is_judged_by_what_its_mask_shows():
    for is_camera in (False, True):
        camera, seen = seen_by(TABLE, is_camera)
        bed, tv = seen.detections
        size = math.sqrt(10 * 20) / camera.fx_px
        assert bed.chance == pytest.approx(TABLE.chance("bed", 0.6, size, 2.5, is_camera=is_camera))
        assert tv.chance == pytest.approx(TABLE.chance("tv", 0.5, 8 / camera.fx_px, 9.0, is_camera=is_camera))


class Judging(Backend):
    name = "judging"

    def __init__(self, seen):
        self.chances = TABLE
        self._seen = seen
        self.stages = (Stage("look", self._look), Stage("calibrate", self.assign_chances))

    def _look(self, batch):
        for task in batch:
            task.result = self._seen

    def embed_texts(self, texts):
        raise NotImplementedError


def test_a_calibrated_backend_tells_cameras_from_robots_by_the_views_name():
    camera, seen = seen_by(TABLE, False)
    backend, picture = Judging(seen), (np.zeros((48, 64, 3), np.uint8), np.full((48, 64), 2.0, np.float32), camera)
    robot, unnamed, far = (
        backend.perceive(*picture, key=key).detections[0].chance
        for key in (("robot/r1", 0, 1), (), ("camera/c1", 0, 1))
    )
    assert backend.calibrated
    assert far < robot == unnamed
