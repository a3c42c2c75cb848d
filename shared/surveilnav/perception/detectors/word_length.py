"""Which words are too long for a detector: its network reads texts of a fixed number of tokens."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from surveilnav.errors import PerceptionError
from surveilnav.perception.detectors.spans import cleaned
from surveilnav.perception.torch_model import tokenizer

_MOST_KEPT = 4096  # answers; all are forgotten then


class WordLength:
    """Says why a detector can't look for a word, from any thread and once a word.

    It has a tokenizer of its own: a tokenizer serves one thread at a time, and the detector's is busy with views.
    """

    def __init__(self, path: Path, most_tokens: int, text_of: Callable[[str], str] = str) -> None:
        """The limit of a folder's model.

        Args:
            path: the folder.
            most_tokens: of a word's text, with the marks at its ends, where the tokenizer has no smaller limit.
            text_of: the text in which the detector looks for a cleaned word.

        Raises:
            PerceptionError: the folder has no tokenizer.
        """
        self._tokenizer, self._text_of = tokenizer(path), text_of
        self._most = min(int(self._tokenizer.model_max_length), most_tokens)
        self._lock = threading.Lock()
        self._said: dict[str, str] = {}

    def refusal(self, word: str) -> str:
        """See ``ChecksWords.refusal``."""
        with self._lock:
            if word not in self._said:
                if len(self._said) >= _MOST_KEPT:
                    self._said.clear()
                self._said[word] = self._why_not(word)
            return self._said[word]

    def _why_not(self, word: str) -> str:
        try:
            text = self._text_of(cleaned(word))
        except PerceptionError as error:
            return str(error)
        n, around = (len(self._tokenizer(said, verbose=False)["input_ids"]) for said in (text, self._text_of("")))
        if n <= self._most:
            return ""
        return (
            f"{word[:100]!r} is too long for this detector: expected up to {self._most - around} tokens (about as many short "
            f"words), got {n - around}. Say it shorter"
        )
