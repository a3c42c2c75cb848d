"""Tiny models that learnt a small home find again what they learnt, by the path on which the big ones run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surveilnav.perception.boxes import Boxes, overlaps
from surveilnav.perception.detectors.grounding_dino import GroundingDino
from surveilnav.perception.embedders.clip import Clip
from surveilnav.perception.prompts import value_prompt
from surveilnav.robot_body import CAMERA
from surveilnav.simulator.truth.choose import choose_backend
from tests.torch.conftest import ROOM_TEXTS, WORDS
from tests.torch.trained import Example, room_views


def found_again(shown: Sequence[Example], found: Sequence[Boxes]) -> tuple[int, int, int]:
    """(things found, things there, boxes that are none of them): the right word, and half of both boxes in common."""
    hits = things = wrong = 0
    for example, boxes in zip(shown, found, strict=True):
        iou = overlaps(example.boxes, boxes.xyxy)[0] if len(boxes) else np.zeros((len(example.names), 0))
        right = iou >= 0.5
        for column, label in enumerate(boxes.labels):
            right[:, column] &= np.array([name == label for name in example.names], bool)
        hits, things = hits + int(right.any(axis=1).sum()), things + len(example.names)
        wrong += int((~right.any(axis=0)).sum())
    return hits, things, wrong


@pytest.mark.slow
def test_a_tiny_grounding_dino_finds_its_two_words_again(
    tiny_grounding_dino: Path, twenty: list[Example], record_property: Any
) -> None:
    detector = GroundingDino(tiny_grounding_dino, "tiny")
    hits, things, wrong = found_again(twenty, detector.detect([e.rgb for e in twenty], [WORDS] * len(twenty)))
    record_property("recall", f"{hits} of {things}, {wrong} wrong")
    assert hits >= 0.9 * things
    assert wrong <= 0.2 * things


@pytest.mark.slow
@pytest.mark.parametrize("word", WORDS)
def test_asked_for_one_word_alone_it_finds_that_words_things_and_no_others(
    tiny_grounding_dino: Path, twenty: list[Example], word: str
) -> None:
    """It looks at what it is asked, not at what it has seen: no box covers the other word's things."""
    detector = GroundingDino(tiny_grounding_dino, "tiny")
    found = things = 0
    for example, boxes in zip(twenty, detector.detect([e.rgb for e in twenty], [(word,)] * len(twenty)), strict=True):
        covered = overlaps(example.boxes, boxes.xyxy)[0] >= 0.5
        own = np.array([name == word for name in example.names])
        assert not covered[~own].any()
        found, things = found + int(covered[own].any(axis=1).sum()), things + int(own.sum())
    assert things >= 5
    assert found >= 0.8 * things


@pytest.mark.slow
def test_words_may_be_asked_for_in_any_order(tiny_grounding_dino: Path, twenty: list[Example]) -> None:
    detector = GroundingDino(tiny_grounding_dino, "tiny", words_per_pass=1)
    hits, things, _ = found_again(twenty, detector.detect([e.rgb for e in twenty], [WORDS[::-1]] * len(twenty)))
    assert hits >= 0.8 * things


@pytest.mark.slow
def test_a_tiny_clip_tells_two_rooms_apart(tiny_clip: Path, home: Any) -> None:
    embedder = Clip(tiny_clip, "tiny")
    texts = embedder.embed_texts(list(ROOM_TEXTS.values()))
    right = total = 0
    for column, room in enumerate(ROOM_TEXTS):
        views = room_views(*home, CAMERA, room, 20, seed=7)  # from other places than it learnt
        none = [Boxes.empty()] * len(views)
        for seen in embedder.embed_views(views, none, [np.zeros(0, np.int64)] * len(views)):
            right += int(np.argmax(texts @ seen.image) == column)
            total += 1
    assert right >= 0.9 * total


@pytest.mark.slow
def test_the_three_together_say_what_and_where_and_how_relevant(
    tiny_grounding_dino: Path, tiny_clip: Path, folder_of: Any, twenty: list[Example], home: Any
) -> None:
    backend = choose_backend(
        "paper", detector=str(tiny_grounding_dino), segmenter=str(folder_of("mobile_sam_onnx")), embedder=str(tiny_clip)
    )
    example = next(e for e in twenty if e.names == ("couch",))
    seen = backend.perceive(example.rgb, np.full(example.rgb.shape[:2], 2.0, np.float32), CAMERA, prompts=WORDS)
    assert seen.detections[0].label == "couch"
    assert overlaps(example.boxes, np.array([seen.detections[0].box_px], np.float32))[0].max() > 0.5
    texts = backend.embed_texts([value_prompt(word) for word in WORDS])
    for room, rgb in ((room, room_views(*home, CAMERA, room, 1, seed=3)[0]) for room in ROOM_TEXTS):
        view = backend.perceive(rgb, np.full(rgb.shape[:2], 2.0, np.float32), CAMERA)
        assert list(ROOM_TEXTS)[int(np.argmax(texts @ view.image_embedding))] == room
