"""The value map's prompt, the word that it names, and targets that a backend can't look for."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from surveilnav.perception.backend import Backend
from surveilnav.perception.pipeline import PipelineBackend
from surveilnav.perception.prompts import prompt_refusal, value_prompt, word_in_prompt
from surveilnav.perception.segmenters.depth_in_box import DepthInBox
from surveilnav.perception.vocabulary import Vocabulary

TWO_WORDS = Vocabulary("baked in", ["bookcase", "samovar"])


class ShortWords:
    """A detector that reads five letters."""

    model, vocabulary = "short@1", None

    def refusal(self, word):
        return f"{word!r} is too long" if len(word) > 5 else ""


class Plain(Backend):
    """A backend that knows these words; None: any."""

    def __init__(self, vocabulary):
        self.vocabulary = vocabulary

    def embed_texts(self, texts):
        raise NotImplementedError


def pipeline(detector):
    """A backend around a detector."""
    embedder = SimpleNamespace(model="e@1", dim=4)
    return PipelineBackend("paper", "for tests", detector, DepthInBox(), embedder, min_score=0.0)


@pytest.mark.parametrize("word", ["couch", "fire extinguisher", "umbrella", "the sims box", "a-frame"])
def test_a_prompt_names_its_word(word):
    assert word_in_prompt(value_prompt(word_in_prompt(word))) == word_in_prompt(word)


def test_a_target_outside_the_vocabulary_is_refused_with_what_is_near():
    backend = Plain(TWO_WORDS)
    assert prompt_refusal(backend, value_prompt("samovar")) == ""
    why = prompt_refusal(backend, value_prompt("bok case"))
    assert "'bok case' is not in this model's vocabulary" in why
    assert "nearest are bookcase" in why


def test_a_target_that_the_detector_refuses_is_refused():
    backend = pipeline(ShortWords())
    assert prompt_refusal(backend, value_prompt("couch")) == ""
    assert prompt_refusal(backend, value_prompt("wardrobe")) == "'wardrobe' is too long"


def test_any_word_is_let_through_where_nobody_checks():
    assert prompt_refusal(pipeline(SimpleNamespace(model="any@1", vocabulary=None)), value_prompt("wardrobe")) == ""
    assert prompt_refusal(Plain(None), value_prompt("wardrobe")) == ""


def test_a_plain_text_names_no_target():
    """Kept objects are compared with it; no detector looks for it."""
    assert prompt_refusal(Plain(TWO_WORDS), "a red couch by the window") == ""
