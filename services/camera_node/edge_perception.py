"""Perception at the edge: the camera runs a small detector on its own views and publishes what it found, in 512 bytes.

The summary serves to choose the floor. A camera far from every robot isn't invoked and sends no pictures, but the planner
should know that it saw a tv. The detector runs on a thread of its own at low priority, so that frames and thumbnails never
wait for it. It shares nothing with the perception service but the library.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import msgspec

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import CAMERA_SUMMARY
from surveilnav.errors import BusError, PerceptionError
from surveilnav.perception import models
from surveilnav.perception.names import BackendName
from surveilnav.sensing.views import looks_straight_down
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core import summary
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.result_cache import ResultCache
from surveilnav.services.camera_node.sources.masked import hide_mask_zones
from surveilnav.services.camera_node.sources.source import Source

_NICE = 10
#: After this time without a new view the backend is dropped, to free the memory of its networks.
_UNLOAD_AFTER_S = 30.0
#: Pause after the backend failed.
_RETRY_S = 60.0


@contextmanager
def open_edge_perception(
    node: Node,
    source: Source,
    settings: CameraSettings,
    *,
    own: OwnPerception,
    n_floors: int,
    busy: Callable[[], bool],
) -> Iterator[EdgePerception | None]:
    """Runs the camera's perception for the length of a ``with`` block.

    None if the settings name no backend, or if the building has fewer than ``settings.min_floors`` floors.

    Args:
        own: what looks at the views.
        n_floors: number of floors of the building.
        busy: whether the camera has something more urgent to do. No view is examined then.
    """
    if not settings.runs_perception or n_floors < settings.min_floors:
        yield None
        return
    perception = EdgePerception(node, source, settings, own, busy)
    perception.start()
    try:
        yield perception
    finally:
        perception.close()


class EdgePerception:
    """Examines one view at a time and publishes the summary, whether or not the camera is invoked."""

    def __init__(
        self,
        node: Node,
        source: Source,
        settings: CameraSettings,
        own: OwnPerception,
        busy: Callable[[], bool] = lambda: False,
    ) -> None:
        source = hide_mask_zones(source, settings)
        self._node, self._source, self._settings, self._own, self._busy = node, source, settings, own, busy
        self._cache = ResultCache(source, settings)
        #: Views from straight above are left out: no detector can read them.
        self._views = [v for v, pose in enumerate(source.views) if not looks_straight_down(pose.matrix())]
        self._examined: dict[int, summary.ViewLabels] = {}
        self._publisher = node.publisher(CAMERA_SUMMARY, floor=source.place.floor, camera=source.place.name)
        self._sent_labels: Mapping[str, float] | None = None
        self._sent_s = self._examined_s = self._failed_s = -math.inf
        self._thread = threading.Thread(target=self._run, name="edge-perception", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def close(self, timeout_s: float = 5.0) -> None:
        """Waits for the view in progress: the thread uses the node's session, which must not be closed before."""
        self._node.stop()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        _lower_priority()
        pause_s = min(0.2, self._settings.look_period_s)
        try:
            while not self._node.stopping.wait(pause_s):
                self._examine(time.monotonic())
                self._publish(time.monotonic())
        except BusError as error:
            if not self._node.stopping.is_set():
                self._node.log.error("the camera's summary can't be put any more", error=str(error))
        except Exception:  # a bug here must not end the camera, nor go unnoticed
            self._node.log.exception("the camera's own perception failed: it goes on without a summary")

    def _examine(self, now_s: float) -> None:
        """Examines one view, if there is a new one and the last one was long enough ago."""
        versions = {v: version for v in self._views if (version := self._source.version(v)) is not None}
        if summary.next_view_to_examine(self._examined, versions) is None:
            if now_s - self._examined_s > _UNLOAD_AFTER_S:
                self._own.unload()
            return
        if now_s - self._failed_s < _RETRY_S or self._busy():
            return
        try:
            recipe = f"seen by {self._settings.perception} with {models.small_weights()}"
            view = self._next_uncached_view(versions, recipe)
            if view is None or now_s - self._examined_s < self._settings.look_period_s:
                return
            self._examined[view] = self._perceive(view, recipe)
        except PerceptionError as error:
            self._failed_s = now_s
            self._node.traffic.reject("own perception")
            self._node.log.warning("the camera can't look by itself", error=str(error), again_in_s=_RETRY_S)
            return
        self._examined_s = time.monotonic()

    def _next_uncached_view(self, versions: Mapping[int, int], recipe: str) -> int | None:
        """The next view that must be examined. Labels that an earlier run found in the same picture are taken from the cache."""
        while (view := summary.next_view_to_examine(self._examined, versions)) is not None:
            labels = self._cache.get(self._cache.key_for(view, recipe), _parse_labels)
            if labels is None:
                return view
            self._examined[view] = summary.ViewLabels(versions[view], labels)
        return None

    def _perceive(self, view: int, recipe: str) -> summary.ViewLabels:
        cache_key = self._cache.key_for(view, recipe)
        picture = self._source.latest(view)
        seen = self._own.see(view, picture)
        labels: dict[str, float] = {}
        for found in seen.perception.detections if seen is not None else ():
            labels[found.label] = max(float(found.confidence), labels.get(found.label, 0.0))
        if not BackendName(self._settings.perception).is_told:  # what those see depends on more than the picture
            self._cache.put(cache_key, view, recipe, [msgspec.json.encode(labels)])
        return summary.ViewLabels(picture.version, labels)

    def _publish(self, now_s: float) -> None:
        """Publishes the summary when it is due; nothing before the first view was examined."""
        if not self._examined:
            return
        labels = summary.merge_labels(self._examined)
        assert CAMERA_SUMMARY.rate_hz is not None
        period_s = 1.0 / CAMERA_SUMMARY.rate_hz
        if summary.summary_due(now_s - self._sent_s, news=labels != self._sent_labels, period_s=period_s):
            self._sent_labels, self._sent_s = labels, now_s
            place = self._source.place
            self._publisher.put(summary.build_summary(place.name, place.floor, labels, stamp_ns=clock_ns()))


def _parse_labels(parts: Sequence[bytes]) -> dict[str, float]:
    return msgspec.json.decode(parts[0], type=dict[str, float])


def _lower_priority() -> None:
    """Lowers the priority of this thread alone, which Linux allows."""
    if sys.platform == "linux":
        me = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, me, min(19, os.getpriority(os.PRIO_PROCESS, me) + _NICE))
