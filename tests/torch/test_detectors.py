"""Detectors with an open vocabulary: batches, what the network is fed, what its answers become."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from surveilnav.errors import PerceptionError
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.detectors.grounding_dino import GroundingDino
from surveilnav.perception.detectors.omdet_turbo import OmDetTurbo
from surveilnav.perception.detectors.owlv2 import Owlv2
from surveilnav.perception.protocols import ChecksWords
from tests.torch import literal

KINDS: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "grounding-dino": (GroundingDino, "grounding_dino", {}),
    "mm-grounding-dino": (GroundingDino, "grounding_dino", {"mm": True}),
    "omdet-turbo": (OmDetTurbo, "omdet_turbo", {}),
    "owlv2": (Owlv2, "owlv2", {}),
}
WORDS = ("couch", "fire extinguisher", "pottedplant")


@pytest.fixture(params=KINDS)
def detector(request: pytest.FixtureRequest, folder_of: Callable[..., Path]) -> Any:
    kind, name, more = KINDS[request.param]
    return kind(folder_of(name, **more), request.param, threshold=0.0)


@pytest.fixture
def grounding_dino(folder_of: Callable[..., Path]) -> GroundingDino:
    return GroundingDino(folder_of("grounding_dino"), "tiny", threshold=0.3, text_threshold=0.25)


def close(a: Boxes, b: Boxes) -> None:
    assert a.words == b.words
    np.testing.assert_allclose(a.xyxy, b.xyxy, atol=1e-3)
    np.testing.assert_allclose(a.scores, b.scores, atol=1e-4)


def answering(detector: Any, **outputs: torch.Tensor) -> dict[str, torch.Tensor]:
    """Puts a network into a detector that says ``outputs`` whatever it is shown; gives what it was fed."""
    fed: dict[str, torch.Tensor] = {}

    def net(**inputs: torch.Tensor) -> Any:
        fed.update(inputs)
        return SimpleNamespace(**outputs)

    detector._model = replace(detector._model, net=net)
    return fed


def test_eight_at_once_are_eight_one_by_one(detector: Any, pictures: list[np.ndarray]) -> None:
    together = detector.detect(pictures, [WORDS] * 8)
    assert all(len(boxes) for boxes in together)
    assert len({boxes.xyxy.tobytes() for boxes in together}) == 8  # it does look at the pictures
    for picture, boxes in zip(pictures, together, strict=True):
        close(boxes, detector.detect([picture], [WORDS])[0])


def test_pictures_of_other_sizes_and_words_do_not_touch_each_other(detector: Any, pictures: list[np.ndarray]) -> None:
    shown = [pictures[0], pictures[1][:100, :130], pictures[2], pictures[3]]
    words = [WORDS, WORDS, ("bed",), ()]
    together = detector.detect(shown, words)
    for picture, asked, boxes in zip(shown, words, together, strict=True):
        close(boxes, detector.detect([picture], [asked])[0])
    assert together[3].words == ()
    assert len(together[3]) == 0


def test_boxes_lie_in_the_picture_the_best_first(detector: Any, pictures: list[np.ndarray]) -> None:
    for boxes in detector.detect(pictures[:2], [WORDS] * 2):
        assert (boxes.xyxy >= 0).all()
        assert (boxes.xyxy <= [160, 120, 160, 120]).all()
        assert (boxes.xyxy[:, 2:] > boxes.xyxy[:, :2]).all()
        assert (np.diff(boxes.best_scores) <= 0).all()
        assert boxes.scores.dtype == boxes.xyxy.dtype == np.float32


LONG = "very " * 300 + "old couch"


def test_a_word_that_cannot_be_looked_for_blinds_nobody(detector: Any, pictures: list[np.ndarray]) -> None:
    asked = [("...", "couch", LONG, "fire extinguisher"), (LONG,), ("couch", "fire extinguisher")]
    found = detector.detect(pictures[:3], asked)
    assert [boxes.words for boxes in found] == asked
    (alone,) = detector.detect(pictures[:1], [("couch", "fire extinguisher")])
    assert len(alone)
    np.testing.assert_allclose(found[0].xyxy, alone.xyxy, atol=1e-3)
    np.testing.assert_allclose(found[0].scores[:, [1, 3]], alone.scores, atol=1e-4)
    assert not found[0].scores[:, [0, 2]].any()
    assert len(found[1]) == 0
    close(found[2], detector.detect(pictures[2:3], asked[2:])[0])


def test_it_says_why_it_cannot_look_for_a_word(detector: Any) -> None:
    assert isinstance(detector, ChecksWords)
    assert detector.refusal("fire extinguisher") == ""
    assert "letters or digits" in detector.refusal("...")
    assert re.search(r"too long .* expected up to \d+ tokens .*, got \d+\. Say it shorter", detector.refusal(LONG))


# --- Grounding DINO -------------------------------------------------------------------------------------------------


def test_grounding_dino_is_fed_pictures_as_its_paper_prepares_them(
    grounding_dino: GroundingDino, pictures: list[np.ndarray]
) -> None:
    fed = answering(grounding_dino, pred_boxes=torch.zeros(1, 3, 4), logits=torch.full((1, 3, 256), -9.0))
    grounding_dino.detect(pictures[:1], [["couch"]])
    # The shorter side becomes 64, unless the longer one would be more than 96: 120 x 160 gives 64 x 85.
    expected = literal.normalised(literal.resized(pictures[0], 64, 85, literal.triangle, 1.0), *literal.IMAGENET)
    np.testing.assert_allclose(fed["pixel_values"][0], expected, atol=1.01 / 255 / 0.224)
    assert np.abs(fed["pixel_values"][0].numpy() - expected).mean() < 1e-3
    assert "pixel_mask" not in fed  # nothing is padded


def test_its_text_is_what_the_tokenizer_makes_of_the_words_with_dots(grounding_dino: GroundingDino) -> None:
    (prompt,) = grounding_dino.prompts(["Couch", "fire extinguisher", "pottedplant", "no. 5"])
    text = "couch. fire extinguisher. pottedplant. no 5."
    assert prompt.ids.tolist() == grounding_dino._tokenizer(text)["input_ids"]
    pieces = [grounding_dino._tokenizer.convert_ids_to_tokens(prompt.ids[a:b].tolist()) for a, b in prompt.spans]
    assert pieces == [["couch"], ["fire", "extinguisher"], ["pot", "##ted", "##plant"], ["no", "5"]]


def test_its_answers_become_boxes_and_a_score_a_word(grounding_dino: GroundingDino, pictures: list[np.ndarray]) -> None:
    cxcywh = torch.tensor([[[0.5, 0.5, 0.5, 0.2], [0.25, 0.75, 0.1, 0.1], [0.8, 0.2, 0.2, 0.2], [0.1, 0.1, 0.1, 0.1]]])
    logits = torch.full((1, 4, 256), -math.inf)
    logits[..., :9] = -6.0  # [CLS] couch . fire extinguisher . pot ted plant
    logits[0, 0, 1], logits[0, 0, 4] = 2.0, -1.2  # couch .88; extinguisher .23: below the text's threshold
    logits[0, 1, 3], logits[0, 1, 4] = -0.5, 0.5  # its best piece is .62
    logits[0, 1, 1] = -1.0  # and couch .27
    logits[0, 2, 0], logits[0, 2, 2] = 5.0, 5.0  # marks are no words
    logits[0, 3, 1] = -0.9  # .289: below the box's threshold
    answering(grounding_dino, pred_boxes=cxcywh, logits=logits)
    (boxes,) = grounding_dino.detect(pictures[:1], [("couch", "fire extinguisher")])
    assert boxes.labels == ["couch", "fire extinguisher"]
    np.testing.assert_allclose(boxes.xyxy, [[40, 48, 120, 72], [32, 84, 48, 96]], atol=1e-3)
    np.testing.assert_allclose(boxes.scores, [[0.8808, 0.0], [0.2689, 0.6225]], atol=1e-4)


def test_passes_give_what_each_word_alone_gives(folder_of: Callable[..., Path], pictures: list[np.ndarray]) -> None:
    one = GroundingDino(folder_of("grounding_dino"), "tiny", threshold=0.0, text_threshold=0.0, words_per_pass=1)
    (boxes,) = one.detect(pictures[:1], [WORDS])
    for column, word in enumerate(WORDS):
        (alone,) = one.detect(pictures[:1], [[word]])
        kept = boxes.scores[:, column] > 0
        found = {tuple(np.round(b, 1)) for b in boxes.xyxy[kept]}
        assert found & {tuple(np.round(b, 1)) for b in alone.xyxy}
        assert boxes.scores[:, column].max() == pytest.approx(alone.scores.max(), abs=1e-4)


def test_three_hundred_words_are_all_looked_for(folder_of: Callable[..., Path], pictures: list[np.ndarray]) -> None:
    detector = GroundingDino(folder_of("grounding_dino"), "tiny", threshold=0.0, text_threshold=0.0)
    words = [f"couch {'no ' * (i % 3)}{i}" for i in range(300)]
    passes = detector.prompts(words)
    assert len(passes) > 4
    assert max(len(prompt.ids) for prompt in passes) <= 256
    (boxes,) = detector.detect(pictures[:1], [words])
    assert boxes.scores.shape[1] == 300
    assert (boxes.scores.max(axis=0) > 0).mean() > 0.5


def test_what_is_no_number_or_has_no_extent_is_no_box(
    grounding_dino: GroundingDino, pictures: list[np.ndarray]
) -> None:
    cxcywh = torch.tensor([[[0.5, 0.5, math.nan, 0.2], [0.5, 0.5, 0.0, 0.0], [0.5, 0.5, 0.2, 0.2]]])
    answering(grounding_dino, pred_boxes=cxcywh, logits=torch.full((1, 3, 256), 3.0))
    (boxes,) = grounding_dino.detect(pictures[:1], [["couch"]])
    np.testing.assert_allclose(boxes.xyxy, [[64, 48, 96, 72]], atol=1e-3)


# --- OmDet-Turbo, OWLv2 ---------------------------------------------------------------------------------------------


def test_omdet_turbo_is_fed_a_stretched_picture_and_a_text_a_word(
    folder_of: Callable[..., Path], pictures: list[np.ndarray]
) -> None:
    detector = OmDetTurbo(folder_of("omdet_turbo"), "tiny", threshold=0.3)
    logits = torch.tensor([[[2.0, -1.0], [-2.0, 1.0], [-2.0, -2.0]]])
    boxes = torch.tensor([[[0.5, 0.5, 0.5, 0.5], [0.1, 0.1, 0.2, 0.2], [0.9, 0.9, 0.1, 0.1]]])
    fed = answering(detector, decoder_coord_logits=boxes, decoder_class_logits=logits)
    (found,) = detector.detect(pictures[:1], [("couch", "bed")])
    expected = literal.normalised(literal.resized(pictures[0], 64, 64, literal.triangle, 1.0), *literal.IMAGENET)
    np.testing.assert_allclose(fed["pixel_values"][0], expected, atol=1.01 / 255 / 0.224)
    texts = detector._tokenizer.batch_decode(
        [*fed["classes_input_ids"], *fed["tasks_input_ids"]], skip_special_tokens=True
    )
    assert ["".join(text.split()) for text in texts] == ["couch", "bed", "detectcouch,bed."]
    assert fed["classes_structure"].tolist() == [2]
    np.testing.assert_allclose(found.xyxy, [[40, 30, 120, 90], [0, 0, 32, 24]], atol=1e-3)
    np.testing.assert_allclose(found.scores, 1 / (1 + np.exp([[-2.0, 1.0], [2.0, -1.0]])), atol=1e-4)


def test_owlv2_pads_below_and_its_boxes_are_shares_of_the_square(
    folder_of: Callable[..., Path], pictures: list[np.ndarray]
) -> None:
    detector = Owlv2(folder_of("owlv2"), "tiny", threshold=0.1)
    boxes = torch.tensor([[[0.5, 0.25, 0.5, 0.25], [0.5, 0.9, 0.2, 0.1]]])
    fed = answering(detector, pred_boxes=boxes, logits=torch.tensor([[[0.0], [3.0]]]))
    (found,) = detector.detect(pictures[:1], [("couch",)])
    np.testing.assert_allclose(found.xyxy, [[40, 20, 120, 60]], atol=1e-3)  # the other lies in the padding
    padding = fed["pixel_values"][0, :, 80:, :].numpy()  # rows 73 to 96 of 96 show nothing
    assert np.abs(padding - padding[:, :1, :1]).max() < 1e-5
    grey = (fed["pixel_values"][0, :, :60].numpy()).mean(axis=(1, 2))
    expected = literal.normalised(pictures[0][:100], *literal.OPENAI).mean(axis=(1, 2))
    np.testing.assert_allclose(grey, expected, atol=0.05)


def test_owlv2_refuses_what_it_would_cut(folder_of: Callable[..., Path]) -> None:
    """Its tiny one reads 40 tokens, of which "a photo of a" and the marks take 11; the tokenizer has one for each letter."""
    detector = Owlv2(folder_of("owlv2"), "tiny")
    assert detector.refusal("x" * 29) == ""
    assert "expected up to 29 tokens (about as many short words), got 30" in detector.refusal("x" * 30)


def test_grounding_dino_refuses_what_fits_into_no_pass(grounding_dino: GroundingDino) -> None:
    longest = " ".join(["couch"] * 253)
    assert grounding_dino.refusal(longest) == ""
    assert len(grounding_dino.prompts([longest])[0].ids) == 256
    assert "expected up to 253 tokens" in grounding_dino.refusal(longest + " couch")
    with pytest.raises(PerceptionError, match="at most 253 tokens"):
        grounding_dino.prompts([longest + " couch"])
