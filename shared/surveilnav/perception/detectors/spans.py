"""Words in the text of Grounding DINO ("samovar. fire extinguisher."), and their scores from those of its tokens.

Each word is a run of tokens, its span. Its score is the highest of the span's tokens, also if the tokenizer splits the word
into several. The network reads at most 256 tokens; more words are looked for in several passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError


@dataclass(frozen=True, slots=True)
class SpecialTokens:
    """Ids of the tokens around and between words. ``separators``: further ids that the network takes for a separator."""

    start: int
    stop: int
    dot: int
    separators: tuple[int, ...] = ()

    def without(self, tokens: Sequence[int]) -> list[int]:
        """The tokens without special ones, which would split a word in two."""
        special = {self.start, self.stop, self.dot, *self.separators}
        return [token for token in tokens if token not in special]


@dataclass(frozen=True, slots=True, eq=False)
class Prompt:
    """The text of one pass.

    Attributes:
        ids: (T,) int64 tokens.
        spans: for each of its words, start and stop of its tokens in ``ids``.
        columns: for each of its words, its index among all words.
    """

    ids: NDArray[np.int64]
    spans: tuple[tuple[int, int], ...]
    columns: tuple[int, ...]


def clean_word(word: str) -> str:
    """The word in lower case, with spaces in the place of unprintable characters, and of dots, which would end it.

    Raises:
        PerceptionError: no letter or digit is left.
    """
    visible = "".join(c if c.isprintable() and c not in ".?" else " " for c in word.lower())
    if not any(c.isalnum() for c in visible):
        raise PerceptionError(f'a word to look for holds letters or digits ("fire extinguisher"), got {word[:40]!r}')
    return " ".join(visible.split())


def build_prompts(
    tokens: Sequence[Sequence[int]], special: SpecialTokens, max_tokens: int, max_words: int = 0
) -> list[Prompt]:
    """The texts of the passes that look for all words, in their order.

    Args:
        tokens: for each word, the ids of its tokens.
        max_tokens: limit for one pass, special tokens included.
        max_words: limit for one pass; 0: none. With fewer words the network tells them apart better, and needs more passes.

    Raises:
        PerceptionError: a single word has too many tokens.
    """
    passes: list[list[int]] = []
    n_tokens = 0
    for column, own in enumerate(map(special.without, tokens)):
        if (n := len(own) + 1) + 2 > max_tokens:  # with its dot, and the tokens at both ends
            raise PerceptionError(f"a word to look for has at most {max_tokens - 3} tokens, got {len(own)}: shorten it")
        if not passes or n_tokens + n > max_tokens - 2 or len(passes[-1]) == max_words > 0:
            passes.append([])
            n_tokens = 0
        passes[-1].append(column)
        n_tokens += n
    return [_prompt(columns, tokens, special) for columns in passes]


def _prompt(columns: Sequence[int], tokens: Sequence[Sequence[int]], special: SpecialTokens) -> Prompt:
    ids, spans = [special.start], []
    for column in columns:
        own = special.without(tokens[column])
        spans.append((len(ids), len(ids) + len(own)))
        ids += [*own, special.dot]
    return Prompt(np.array([*ids, special.stop], np.int64), tuple(spans), tuple(columns))


def word_scores(logits: NDArray[np.float32], prompt: Prompt, n_words: int) -> NDArray[np.float32]:
    """(Q, ``n_words``) float32, 0-1: how well each word fits each of Q boxes; 0 for words of other passes.

    ``logits``: (Q, T or more), the network's output for each token; minus infinity where there is no token.
    """
    scores = np.zeros((len(logits), n_words), np.float32)
    for column, (start, stop) in zip(prompt.columns, prompt.spans, strict=True):
        if stop > start:  # a word of special tokens alone has an empty span
            scores[:, column] = _sigmoid(logits[:, start:stop].max(axis=1))
    return scores


def _sigmoid(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)), np.float32)  # by tanh, which doesn't overflow
