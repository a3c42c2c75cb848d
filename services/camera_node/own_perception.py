"""The camera's own detector, for the tiers in which it sends what it sees and not its pictures."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property

from surveilnav.perception.backend import Backend
from surveilnav.sensing.tiers import Seen
from surveilnav.sensing.views import looks_straight_down, measured_depth_m
from surveilnav.services.camera_node.sources.source import Picture, Source


class OwnPerception:
    """Looks at the pictures of one source. The networks are loaded when the first picture is looked at."""

    def __init__(self, source: Source, load: Callable[[], Backend]) -> None:
        self._source, self._load, self._lock = source, load, threading.Lock()

    @cached_property
    def _backend(self) -> Backend:
        return self._load()

    @property
    def is_told(self) -> bool:
        """Whether it is told the truth, so that what it sees depends on more than the picture."""
        with self._lock:
            return self._backend.needs_truth

    def see(self, view: int, picture: Picture) -> Seen | None:
        """What is in a picture; None for a view from straight above, which no detector can read.

        Raises:
            PerceptionError: the networks can't be loaded, or failed.
        """
        if looks_straight_down(self._source.views[view].matrix()):
            return None
        key = (f"camera/{self._source.place.name}", view, picture.version + 1)
        depth_m = measured_depth_m(picture.depth_m, picture.depth_source)
        with self._lock:
            backend = self._backend
            truth = picture.truth if backend.needs_truth else None  # a real backend is never given the truth
            found = backend.perceive(picture.rgb, depth_m, self._source.intrinsics, truth=truth, key=key)
            return Seen(found, backend.models)
