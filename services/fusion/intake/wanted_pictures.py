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
        self._words: dict[str, dict[int, frozenset[str]]] = {}  # by source, by view

    def looked(self, key: ViewKey, words: Iterable[str]) -> None:
        """A camera has looked at a view for ``words``, and has sent no picture."""
        with self._lock:
            self._words.setdefault(key[0], {})[key[1]] = frozenset(words)

    def came(self, key: ViewKey) -> None:
        """A picture of a view has come."""
        with self._lock:
            self._words.get(key[0], {}).pop(key[1], None)

    def forget(self, source: str) -> None:
        """Forgets a camera, which isn't invoked any more."""
        with self._lock:
            self._words.pop(source, None)

    def of(self, camera: str) -> list[int]:
        """The views of a camera of which pictures are wanted now."""
        return self._lacking([f"camera/{camera}"]).get(camera, [])

    def by_camera(self) -> dict[str, list[int]]:
        """By camera, the views of which pictures are wanted now; none without any."""
        with self._lock:
            sources = list(self._words)
        return self._lacking(sources) if sources else {}

    def _lacking(self, sources: Iterable[str]) -> dict[str, list[int]]:
        searched = self._searched.targets()
        lacks: dict[frozenset[str], bool] = {}
        found: dict[str, list[int]] = {}
        if not searched:
            return {}
        with self._lock:
            for source in sources:
                views = self._words.get(source, {})
                for words in views.values():  # most views were looked at for the same words
                    if words not in lacks:
                        lacks[words] = bool(searched - words)
                if wanted := sorted(view for view, words in views.items() if lacks[words]):
                    found[source.partition("/")[2]] = wanted
        return found
