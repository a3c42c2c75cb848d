"""Token spans against a slow literal reading of the text, token by token."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.errors import PerceptionError
from surveilnav.perception.detectors.spans import SpecialTokens, build_prompts, clean_word, word_scores

_SPECIAL = SpecialTokens(start=101, stop=102, dot=1012, separators=(1029,))

words_of_tokens = st.lists(st.lists(st.integers(2000, 2050), min_size=1, max_size=6), min_size=1, max_size=30)


def literal_scores(ids: list[int], logits: np.ndarray) -> np.ndarray:
    """(Q, words of this text): walks along the text; a dot ends a word; its score is the best sigmoid of its tokens."""
    columns: list[list[float]] = []
    word: list[list[float]] = []
    for position, token in enumerate(ids):
        if token == _SPECIAL.start or token == _SPECIAL.stop:
            continue
        if token == _SPECIAL.dot:
            columns.append([max(token_scores) for token_scores in zip(*word, strict=True)])
            word = []
        else:
            word.append([1 / (1 + math.exp(-float(logits[q, position]))) for q in range(len(logits))])
    return np.array(columns).T


@given(words_of_tokens, st.integers(9, 40), st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_scores_are_those_of_a_literal_walk_along_each_text(
    tokens: list[list[int]], max_tokens: int, max_words: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    passes = build_prompts(tokens, _SPECIAL, max_tokens, max_words)
    for prompt in passes:
        logits = rng.normal(0, 4, (5, max_tokens)).astype(np.float32)
        logits[:, len(prompt.ids) :] = -np.inf  # as the network pads
        scores = word_scores(logits, prompt, len(tokens))
        expected = literal_scores(prompt.ids.tolist(), logits)
        np.testing.assert_allclose(scores[:, list(prompt.columns)], expected, atol=1e-6)
        others = np.setdiff1d(np.arange(len(tokens)), prompt.columns)
        assert not scores[:, others].any()


@given(words_of_tokens, st.integers(9, 40), st.integers(0, 5))
def test_passes_hold_every_word_once_in_order_and_none_is_too_long(
    tokens: list[list[int]], max_tokens: int, max_words: int
) -> None:
    passes = build_prompts(tokens, _SPECIAL, max_tokens, max_words)
    assert [column for prompt in passes for column in prompt.columns] == list(range(len(tokens)))
    for prompt in passes:
        assert len(prompt.ids) <= max_tokens
        assert max_words == 0 or len(prompt.columns) <= max_words
        for (start, stop), column in zip(prompt.spans, prompt.columns, strict=True):
            assert prompt.ids[start:stop].tolist() == tokens[column]


def test_as_few_passes_as_can_be() -> None:
    tokens = [[2000 + i] for i in range(300)]  # two tokens each with its dot: (256 - 2) / 2 words fit
    assert [len(prompt.columns) for prompt in build_prompts(tokens, _SPECIAL, 256)] == [127, 127, 46]
    assert [len(prompt.columns) for prompt in build_prompts(tokens[:7], _SPECIAL, 256, max_words=3)] == [3, 3, 1]


def test_a_mark_inside_a_word_does_not_cut_it_in_two() -> None:
    (prompt,) = build_prompts([[2001, 1012, 2002, 1029, 102, 2003], [2004]], _SPECIAL, 256)
    assert prompt.ids.tolist() == [101, 2001, 2002, 2003, 1012, 2004, 1012, 102]
    assert prompt.spans == ((1, 4), (5, 6))


def test_a_word_of_marks_alone_is_found_nowhere() -> None:
    (prompt,) = build_prompts([[1012], [2004]], _SPECIAL, 256)
    assert word_scores(np.full((2, 256), 9.0, np.float32), prompt, 2)[:, 0].tolist() == [0.0, 0.0]


def test_a_word_too_long_for_the_network_is_refused() -> None:
    with pytest.raises(PerceptionError, match="at most 253 tokens, got 254: shorten it"):
        build_prompts([[2000] * 254], _SPECIAL, 256)
    (prompt,) = build_prompts([[2000] * 253], _SPECIAL, 256)
    assert len(prompt.ids) == 256


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("Fire  Extinguisher", "fire extinguisher"),
        ("t.v. stand", "t v stand"),
        ("bed\x00\n room\x1b[31m?", "bed room [31m"),
        ("größe 5", "größe 5"),
    ],
)
def test_words_are_cleaned(word: str, expected: str) -> None:
    assert clean_word(word) == expected


@pytest.mark.parametrize("word", ["", "...", "\x00\x07", "?!"])
def test_what_names_nothing_is_refused(word: str) -> None:
    with pytest.raises(PerceptionError, match="holds letters or digits"):
        clean_word(word)
