"""Answers that several ask for at once: one is made, and kept for a moment."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

_MOST = 256
T = TypeVar("T")


@dataclass(slots=True)
class _Kept(Generic[T]):
    made_s: float = -1e9
    answer: T | None = None
    failed: Exception | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)


class SingleFlight(Generic[T]):
    """The newest answer to each question, made anew when it is older than ``fresh_s``; to the ``most`` that were asked last."""

    def __init__(self, fresh_s: float = 1.0, most: int = _MOST) -> None:
        self._fresh_s, self._most = fresh_s, most
        self._kept: OrderedDict[Hashable, _Kept[T]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, question: Hashable, make: Callable[[], T]) -> T:
        """The answer; whoever asks for one that is being made waits for it, and gets what ``make`` raised, too: many viewers
        of a camera that doesn't answer wait once for it, not one after the other."""
        with self._lock:
            kept = self._kept.setdefault(question, _Kept())
            self._kept.move_to_end(question)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        with kept.lock:
            if time.monotonic() - kept.made_s > self._fresh_s:
                try:
                    kept.answer, kept.failed = make(), None
                except Exception as error:
                    kept.answer, kept.failed = None, error
                kept.made_s = time.monotonic()
            if kept.answer is None:
                assert kept.failed is not None
                raise kept.failed
            return kept.answer

    def clear(self) -> None:
        """Forgets all answers, also those that are being made: who asks from now on has them made anew."""
        with self._lock:
            self._kept.clear()

    def drop(self, older_s: float) -> int:
        """Forgets answers that were made longer ago; how many. One that is being made stays."""
        now_s = time.monotonic()
        with self._lock:
            old = [
                question
                for question, kept in self._kept.items()
                if not kept.lock.locked() and now_s - kept.made_s >= older_s
            ]
            for question in old:
                del self._kept[question]
        return len(old)
