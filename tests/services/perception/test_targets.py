"""Targets that a worker can't look for: a mission hears of it before it starts."""

from __future__ import annotations

import pytest

from surveilnav.bus import Refused
from surveilnav.contract import PERCEPTION_TEXT
from surveilnav.messages import InferRequest
from surveilnav.perception.prompts import value_prompt
from surveilnav.perception.vocabulary import Vocabulary


def embedded(worker, text):
    return worker.ask((InferRequest(stamp_ns=1, texts=[text]), b""), PERCEPTION_TEXT).embeddings


def test_a_detector_with_words_of_its_own_refuses_other_targets(make_worker, scripted):
    backend = scripted()
    backend.vocabulary = Vocabulary("baked in", ["bookcase", "chair"])
    worker = make_worker(backend)
    assert len(embedded(worker, value_prompt("bookcase"))) == 1
    assert len(embedded(worker, "book case")) == 1  # what is kept may be searched by any text
    with pytest.raises(
        Refused, match=r"'bok case' is not in .* \(baked in, 2 classes\); nearest are bookcase"
    ) as error:
        embedded(worker, value_prompt("bok case"))
    assert error.value.name == "bad_target"
    assert value_prompt("bok case") not in backend.texts


def test_a_word_that_is_too_long_for_the_detector_is_refused(make_worker, scripted):
    backend = scripted()
    backend.refusal = lambda word: "too long for this detector" if len(word) > 20 else ""
    worker = make_worker(backend)
    assert len(embedded(worker, value_prompt("chair"))) == 1
    with pytest.raises(Refused, match="too long for this detector") as error:
        embedded(worker, value_prompt("chair of the second assistant"))
    assert error.value.name == "bad_target"
