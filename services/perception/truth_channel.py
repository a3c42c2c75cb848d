"""The channel that only ``oracle`` and ``simulated`` have: instance ids of views, put by simulator nodes."""

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

_Key = tuple[str, int, int]
#: Gives the instance ids of a view; WireError: they don't decode.
Told = Callable[[], TrueInstances]
#: Is handed them, or why there are none.
Then = Callable[[Told | Refused], None]


class TruthChannel:
    """Keeps the newest views' instance ids, still packed, and hands them out by (source, view, seq).

    Nobody waits on a thread for them: who asks is called back.
    """

    def __init__(self, node: Node, backend: str, settings: PerceptionSettings) -> None:
        """``backend``: the name of the one that is told."""
        self._backend, self._kept, self._wait_s = backend, settings.truth_kept, settings.truth_wait_s
        self._packed: OrderedDict[_Key, Told] = OrderedDict()
        self._asked: dict[_Key, list[tuple[float, Then]]] = {}
        self._lock = threading.Lock()
        self._subscription = node.subscribe(TRUTH, self._keep)

    def ask(self, key: _Key, then: Then) -> None:
        """Calls ``then`` with a view's instance ids when they are there, now or later, or with a refusal when they don't
        come in time."""
        with self._lock:
            told = self._packed.get(key)
            if told is None:
                self._asked.setdefault(key, []).append((time.monotonic() + self._wait_s, then))
        if told is not None:
            then(told)

    def expire(self, now_s: float) -> None:
        """Refuses those whose time is over; ``now_s`` is the monotonic clock's."""
        with self._lock:
            late = [(key, then) for key, asked in self._asked.items() for until_s, then in asked if until_s <= now_s]
            for key in {key for key, _ in late}:
                self._asked[key] = [(until_s, then) for until_s, then in self._asked[key] if until_s > now_s]
                if not self._asked[key]:
                    del self._asked[key]
        for (source, view, seq), then in late:
            then(
                Refused(
                    "no_truth",
                    f"no instance ids of {source} view {view} seq {seq} arrived: "
                    f"the backend {self._backend} runs only where simulator nodes put them",
                )
            )

    def _keep(self, received: Received[Truth]) -> None:
        truth = received.message
        key, told = (truth.source, truth.view, truth.seq), partial(truth_from_wire, truth, received.payload)
        with self._lock:
            self._packed[key] = told
            while len(self._packed) > self._kept:
                self._packed.popitem(last=False)
            asked = self._asked.pop(key, [])
        for _, then in asked:
            then(told)
