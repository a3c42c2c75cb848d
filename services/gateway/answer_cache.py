"""A cache of answers that several clients ask for at the same time."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

_MAX_ENTRIES = 256
T = TypeVar("T")


@dataclass(slots=True)
class CacheEntry(Generic[T]):
    """The answer to one question, or the exception that computing it raised. Its lock is held while it is computed."""

    made_s: float = -1e9
    answer: T | None = None
    error: Exception | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)


class AnswerCache(Generic[T]):
    """Caches the answers to the ``max_entries`` most recent questions.

    An answer older than ``max_age_s`` is computed again. Concurrent callers with the same question share one computation
    (like Go's singleflight), also if it fails: many viewers of a camera that doesn't answer wait for one time-out only.
    """

    def __init__(self, max_age_s: float = 1.0, max_entries: int = _MAX_ENTRIES) -> None:
        self._max_age_s, self._max_entries = max_age_s, max_entries
        self._entries: OrderedDict[Hashable, CacheEntry[T]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, question: Hashable, compute: Callable[[], T]) -> T:
        """The answer to a question. Raises what ``compute`` raised."""
        with self._lock:
            entry = self._entries.setdefault(question, CacheEntry())
            self._entries.move_to_end(question)
            if len(self._entries) > self._max_entries:
                self._entries.popitem(last=False)
        with entry.lock:
            if time.monotonic() - entry.made_s > self._max_age_s:
                try:
                    entry.answer, entry.error = compute(), None
                except Exception as error:
                    entry.answer, entry.error = None, error
                entry.made_s = time.monotonic()
            if entry.answer is None:
                assert entry.error is not None
                raise entry.error
            return entry.answer

    def clear(self) -> None:
        """Removes all answers. An answer that is being computed goes to those who wait for it, but isn't cached."""
        with self._lock:
            self._entries.clear()

    def drop_older(self, age_s: float) -> int:
        """Removes answers of at least this age and returns their number. An answer that is being computed stays."""
        now_s = time.monotonic()
        with self._lock:
            old = [
                question
                for question, entry in self._entries.items()
                if not entry.lock.locked() and now_s - entry.made_s >= age_s
            ]
            for question in old:
                del self._entries[question]
        return len(old)
