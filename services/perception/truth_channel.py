"""Instance ids of views, which simulator nodes publish for the backends ``oracle`` and ``simulated`` alone."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from functools import partial

from surveilnav.bus import Node, Received, Refused
from surveilnav.contract import TRUTH
from surveilnav.messages import Truth
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.perception.config import PerceptionSettings

_ViewKey = tuple[str, int, int]
#: Decodes the instance ids of a view; raises WireError if that fails.
TruthLoader = Callable[[], TrueInstances]
#: Called with the instance ids, or with the reason why there are none.
OnTruth = Callable[[TruthLoader | Refused], None]


class TruthChannel:
    """Stores the newest views' instance ids, still packed, and hands them out by (source, view, seq).

    Picture and instance ids of a view arrive in any order. A request for ids that haven't arrived is called back later, so
    that it blocks no thread.
    """

    def __init__(self, node: Node, backend: str, settings: PerceptionSettings) -> None:
        """``backend``: name of the backend, for error messages."""
        self._backend, self._capacity, self._wait_s = backend, settings.truth_capacity, settings.truth_wait_s
        self._loaders: OrderedDict[_ViewKey, TruthLoader] = OrderedDict()
        #: By view, the time until which each callback waits, and the callback.
        self._waiting: dict[_ViewKey, list[tuple[float, OnTruth]]] = {}
        self._lock = threading.Lock()
        self._subscription = node.subscribe(TRUTH, self._on_truth)

    def request(self, key: _ViewKey, callback: OnTruth) -> None:
        """Calls ``callback`` with a view's instance ids, now or when they arrive, or with a refusal if they don't in time."""
        with self._lock:
            loader = self._loaders.get(key)
            if loader is None:
                self._waiting.setdefault(key, []).append((time.monotonic() + self._wait_s, callback))
        if loader is not None:
            callback(loader)

    def expire(self, now_s: float) -> None:
        """Refuses the requests that have waited too long. ``now_s``: time of the monotonic clock."""
        with self._lock:
            late = [
                (key, callback)
                for key, waiting in self._waiting.items()
                for until_s, callback in waiting
                if until_s <= now_s
            ]
            for key in {key for key, _ in late}:
                self._waiting[key] = [entry for entry in self._waiting[key] if entry[0] > now_s]
                if not self._waiting[key]:
                    del self._waiting[key]
        for (source, view, seq), callback in late:
            callback(
                Refused(
                    "no_truth",
                    f"no instance ids of {source} view {view} seq {seq} arrived: "
                    f"the backend {self._backend} runs only where simulator nodes put them",
                )
            )

    def _on_truth(self, received: Received[Truth]) -> None:
        truth = received.message
        key, loader = (truth.source, truth.view, truth.seq), partial(truth_from_wire, truth, received.payload)
        with self._lock:
            self._loaders[key] = loader
            while len(self._loaders) > self._capacity:
                self._loaders.popitem(last=False)
            waiting = self._waiting.pop(key, [])
        for _, callback in waiting:
            callback(loader)
