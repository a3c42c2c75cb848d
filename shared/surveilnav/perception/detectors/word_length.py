"""Finds words that are too long for a detector, whose network reads texts of a limited number of tokens."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from surveilnav.errors import PerceptionError
from surveilnav.perception.detectors.spans import clean_word
from surveilnav.perception.torch_model import load_tokenizer

_MAX_CACHED = 4096  # answers; when there are more, all are dropped


class WordLengthCheck:
    """Says why a detector can't look for a word. Thread-safe; answers are cached.

    It has its own tokenizer, because tokenizers aren't thread-safe and the detector uses its tokenizer at the same time.
    """

    def __init__(self, path: Path, max_tokens: int, text_for: Callable[[str], str] = str) -> None:
        """Loads the tokenizer of a model.

        Args:
            max_tokens: limit for a word's text, special tokens included. The tokenizer may have a lower one.
            text_for: makes the text with which the detector looks for a word.

        Raises:
            PerceptionError: the folder has no tokenizer.
        """
        self._tokenizer, self._text_for = load_tokenizer(path), text_for
        self._max_tokens = min(int(self._tokenizer.model_max_length), max_tokens)
        self._lock = threading.Lock()
        self._answers: dict[str, str] = {}

    def refusal(self, word: str) -> str:
        with self._lock:
            if word not in self._answers:
                if len(self._answers) >= _MAX_CACHED:
                    self._answers.clear()
                self._answers[word] = self._check(word)
            return self._answers[word]

    def _check(self, word: str) -> str:
        try:
            text = self._text_for(clean_word(word))
        except PerceptionError as error:
            return str(error)
        n, around = (len(self._tokenizer(t, verbose=False)["input_ids"]) for t in (text, self._text_for("")))
        if n <= self._max_tokens:
            return ""
        return (
            f"{word[:100]!r} is too long for this detector: expected up to {self._max_tokens - around} tokens "
            f"(about as many short words), got {n - around}. Say it shorter"
        )
