"""Pictures that several viewers ask for at once: one is made."""

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
    picture: T | None = None
    failed: Exception | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)


class Thumbnails(Generic[T]):
    """The newest picture of each view, made anew when it is older than ``fresh_s``; the ``most`` that were asked for last."""

    def __init__(self, fresh_s: float = 1.0, most: int = _MOST) -> None:
        self._fresh_s, self._most = fresh_s, most
        self._kept: OrderedDict[Hashable, _Kept[T]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, view: Hashable, make: Callable[[], T], is_enough: Callable[[T], bool] | None = None) -> T:
        """The picture; whoever asks for one that is being made waits for it, and gets what ``make`` raised, too: many viewers
        of a camera that doesn't answer wait once for it, not one after the other. ``is_enough``: whether a kept one will do,
        however old it is."""
        with self._lock:
            kept = self._kept.setdefault(view, _Kept())
            self._kept.move_to_end(view)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        with kept.lock:
            old = time.monotonic() - kept.made_s > self._fresh_s
            if old if is_enough is None or kept.picture is None else not is_enough(kept.picture):
                try:
                    kept.picture, kept.failed = make(), None
                except Exception as error:
                    kept.picture, kept.failed = None, error
                kept.made_s = time.monotonic()
            if kept.picture is None:
                assert kept.failed is not None
                raise kept.failed
            return kept.picture

    def drop(self, older_s: float) -> int:
        """Forgets pictures that were made longer ago; how many. One that is being made stays."""
        now_s = time.monotonic()
        with self._lock:
            old = [
                view for view, kept in self._kept.items() if not kept.lock.locked() and now_s - kept.made_s >= older_s
            ]
            for view in old:
                del self._kept[view]
        return len(old)
