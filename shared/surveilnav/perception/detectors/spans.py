"""Words as Grounding DINO reads them: one text "samovar. fire extinguisher.", and a score for each of its tokens.

Each word is a run of tokens, its span. A word's score is the highest of its own span, so a word that the tokenizer cuts
into pieces keeps all of them, and neighbours aren't glued together. The network sees at most 256 tokens: more words are
looked for in several passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError


@dataclass(frozen=True, slots=True)
class Marks:
    """Ids of what isn't part of a word. ``inside``: further ids that the network takes for a mark between words."""

    start: int
    stop: int
    dot: int
    inside: tuple[int, ...] = ()

    def without(self, tokens: Sequence[int]) -> list[int]:
        """The tokens that are a word's own: a mark inside a word would cut it in two."""
        marks = {self.start, self.stop, self.dot, *self.inside}
        return [token for token in tokens if token not in marks]


@dataclass(frozen=True, slots=True, eq=False)
class Prompt:
    """The text of one pass: ``ids`` (T,) int64; ``spans``: of each of its words the tokens ``ids[start:stop]``;
    ``columns``: the words' places among all that were asked for."""

    ids: NDArray[np.int64]
    spans: tuple[tuple[int, int], ...]
    columns: tuple[int, ...]


def cleaned(word: str) -> str:
    """The word in lower case, without what can't be seen, and with dots as spaces: a dot would end it.

    Raises:
        PerceptionError: nothing is left.
    """
    seen = "".join(c if c.isprintable() and c not in ".?" else " " for c in word.lower())
    if not any(c.isalnum() for c in seen):
        raise PerceptionError(f'a word to look for holds letters or digits ("fire extinguisher"), got {word[:40]!r}')
    return " ".join(seen.split())


def prompts(tokens: Sequence[Sequence[int]], marks: Marks, most_tokens: int, most_words: int = 0) -> list[Prompt]:
    """The passes that look for all words, in their order.

    Args:
        tokens: of each word the ids of its tokens.
        marks: what stands around and between words.
        most_tokens: of one pass, marks included.
        most_words: of one pass; 0: as many as fit. Fewer take longer and are told apart better.

    Raises:
        PerceptionError: a word alone has too many tokens.
    """
    passes: list[list[int]] = []
    n_tokens = 0
    for column, own in enumerate(map(marks.without, tokens)):
        if (n := len(own) + 1) + 2 > most_tokens:  # its dot; the marks at both ends
            raise PerceptionError(
                f"a word to look for has at most {most_tokens - 3} tokens, got {len(own)}: shorten it"
            )
        if not passes or n_tokens + n > most_tokens - 2 or len(passes[-1]) == most_words > 0:
            passes.append([])
            n_tokens = 0
        passes[-1].append(column)
        n_tokens += n
    return [_prompt(columns, tokens, marks) for columns in passes]


def _prompt(columns: Sequence[int], tokens: Sequence[Sequence[int]], marks: Marks) -> Prompt:
    ids, spans = [marks.start], []
    for column in columns:
        own = marks.without(tokens[column])
        spans.append((len(ids), len(ids) + len(own)))
        ids += [*own, marks.dot]
    return Prompt(np.array([*ids, marks.stop], np.int64), tuple(spans), tuple(columns))


def word_scores(logits: NDArray[np.float32], prompt: Prompt, n_words: int) -> NDArray[np.float32]:
    """(Q, ``n_words``) float32, 0-1: how well each word fits each of Q boxes; 0 for words of other passes.

    ``logits`` (Q, T or more): the network's, a token a column; minus infinity where there is none.
    """
    scores = np.zeros((len(logits), n_words), np.float32)
    for column, (start, stop) in zip(prompt.columns, prompt.spans, strict=True):
        if stop > start:  # a word of marks alone has nothing to be found by
            scores[:, column] = _sigmoid(logits[:, start:stop].max(axis=1))
    return scores


def _sigmoid(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)), np.float32)  # tanh doesn't overflow
