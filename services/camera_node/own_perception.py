"""The camera's own detector: for its summary, and for the tiers in which it sends what it sees and not its pictures."""

from __future__ import annotations

import threading
from collections.abc import Callable

from surveilnav.errors import PerceptionError
from surveilnav.perception.backend import Backend
from surveilnav.sensing.tiers import Seen
from surveilnav.sensing.views import looks_straight_down, measured_depth_m
from surveilnav.services.camera_node.sources.source import Picture, Source


class OwnPerception:
    """Looks at the pictures of one source. Safe from several threads: one picture is looked at after the other."""

    def __init__(
        self, source: Source, load: Callable[[], Backend], report: Callable[[str], None] = lambda _: None
    ) -> None:
        """``load`` makes the backend, when the first picture is looked at; ``report`` gets its name then."""
        self._source, self._load, self._report, self._lock = source, load, report, threading.Lock()
        self._backend: Backend | None = None

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
            if self._backend is None:
                self._backend = self._load()
                self._report(self._backend.name)
            backend = self._backend
            truth = picture.truth if backend.needs_truth else None  # a real backend is never given the truth
            try:
                found = backend.perceive(picture.rgb, depth_m, self._source.intrinsics, truth=truth, key=key)
            except PerceptionError:
                raise
            except Exception as error:  # of the runtime of networks, for instance, which has errors of its own
                raise PerceptionError(f"{backend.name} failed: {type(error).__name__}: {error}") from error
            return Seen(found, backend.models)

    def unload(self) -> None:
        """Frees the memory of the networks until a picture is looked at again."""
        with self._lock:
            self._backend = None
