from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.benchmark.studies.calibration.in_coco_words import InCocoWords
from surveilnav.geometry import Pinhole
from surveilnav.perception.embedders import class_space
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.vocabulary import COCO
from tests.compact_file import write

CAMERA = Pinhole.from_hfov(128, 96, math.radians(79))


@pytest.fixture
def backend(tmp_path, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_COMPACT", str(write(tmp_path / "compact.onnx", blackness=6.0)))
    return InCocoWords()


def looked_at(backend, rgb):
    picture = np.empty((96, 128, 3), np.uint8)
    picture[:] = rgb
    return backend.perceive(picture, np.full((96, 128), 2.0, np.float32), CAMERA)


def test_what_coco_has_a_word_for_is_found_and_named_so(backend):
    seen = looked_at(backend, (255, 0, 0))
    assert {d.label for d in seen.detections} == {"tv"}
    assert seen.embedding_model == ClassSpace.model
    presence = class_space.presence(seen.image_embedding)
    assert presence.argmax() == COCO.index("tv")
    assert tuple(seen.words) == tuple(COCO)


def test_what_coco_has_no_word_for_is_left_out(backend):
    """The tiny network takes black for a chest of drawers."""
    seen = looked_at(backend, (0, 0, 0))
    assert seen.detections == ()
    assert class_space.presence(seen.image_embedding).max() < 0.25


def test_its_id_names_the_weights(backend):
    assert backend.models.segmenter.startswith("compact@")
    assert backend.models.detector != backend.models.segmenter, "looks in COCO's words are kept apart"
