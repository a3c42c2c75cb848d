"""Which views of cameras that look by themselves are wanted as pictures: those that weren't looked at for what is searched."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from surveilnav.services.fusion.intake.words import SearchedWords
from surveilnav.services.fusion.perceived import ViewKey


class WantedPictures:
    """Remembers for which words cameras have looked at their views. Thread-safe."""

    def __init__(self, searched: SearchedWords) -> None:
        self._searched, self._lock = searched, threading.Lock()
        self._words: dict[ViewKey, frozenset[str]] = {}

    def looked(self, key: ViewKey, words: Iterable[str]) -> None:
        """A camera has looked at a view for ``words``, and has sent no picture."""
        with self._lock:
            self._words[key] = frozenset(words)

    def came(self, key: ViewKey) -> None:
        """A picture of a view has come."""
        with self._lock:
            self._words.pop(key, None)

    def forget(self, source: str) -> None:
        """Forgets a camera, which isn't invoked any more."""
        with self._lock:
            self._words = {key: words for key, words in self._words.items() if key[0] != source}

    def of(self, camera: str) -> list[int]:
        """The views of a camera of which pictures are wanted now."""
        searched = self._searched.targets()
        if not searched:
            return []
        with self._lock:
            return sorted(
                view
                for (source, view), words in self._words.items()
                if source == f"camera/{camera}" and searched - words
            )
