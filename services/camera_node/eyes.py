"""A camera's own eyes: it looks at its views by itself and tells in at most 512 bytes what it saw.

For choosing the floor: a camera far from every robot is not invoked and sends no picture, and yet the planner
should know that it saw a tv. Looking has a thread of its own at low priority; frames and thumbnails never wait for it.
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
from surveilnav.perception.backend import Backend
from surveilnav.sensing.views import looks_straight_down
from surveilnav.services.camera_node import core
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.kept import Kept
from surveilnav.services.camera_node.sources.masked import masked
from surveilnav.services.camera_node.sources.source import Source

_NICE = 10
#: Without anything to look at for so long, the networks' memory is given back.
_RELEASE_S = 30.0
_RETRY_S = 60.0


@contextmanager
def open_eyes(
    node: Node,
    source: Source,
    settings: CameraSettings,
    *,
    n_floors: int,
    load: Callable[[], Backend],
    busy: Callable[[], bool],
) -> Iterator[Eyes | None]:
    """The camera's eyes, looking; None where it has no perception, or where there is no floor to choose.

    ``n_floors``: of the building; ``load`` makes the backend; ``busy`` says when the camera has more important
    things to do: no look begins then.
    """
    if not settings.looks or n_floors < settings.least_floors:
        yield None
        return
    eyes = Eyes(node, source, settings, load, busy)
    eyes.start()
    try:
        yield eyes
    finally:
        eyes.close()


class Eyes:
    """Looks at one view at a time and puts the summary, invoked or not. ``load`` makes the backend when it is needed."""

    def __init__(
        self,
        node: Node,
        source: Source,
        settings: CameraSettings,
        load: Callable[[], Backend],
        busy: Callable[[], bool] = lambda: False,
    ) -> None:
        source = masked(source, settings)
        self._node, self._source, self._settings, self._load, self._busy = node, source, settings, load, busy
        self._kept, self._how = Kept(source, settings), ""
        self._views = [v for v, pose in enumerate(source.views) if not looks_straight_down(pose.matrix())]
        self._seen: dict[int, core.Seen] = {}
        self._backend: Backend | None = None
        self._publisher = node.publisher(CAMERA_SUMMARY, floor=source.place.floor, camera=source.place.name)
        self._said: tuple[Mapping[str, float], float] | None = None
        self._looked_s, self._failed_s = -math.inf, -math.inf
        self._thread = threading.Thread(target=self._run, name="eyes", daemon=True)

    def start(self) -> None:
        """Begins to look, on a thread of its own."""
        self._thread.start()

    def close(self, timeout_s: float = 5.0) -> None:
        """Waits for a look in progress: the node's session must outlive it."""
        self._node.stop()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        _lower_priority()
        pause_s = min(0.2, self._settings.look_period_s)
        try:
            while not self._node.stopping.wait(pause_s):
                self._look(time.monotonic())
                self._tell(time.monotonic())
        except BusError as error:
            if not self._node.stopping.is_set():
                self._node.log.error("the camera's summary can't be put any more", error=str(error))
        except Exception:  # a bug in looking must not end the camera, nor stay silent
            self._node.log.exception("the camera's own perception failed: it goes on without a summary")

    def _look(self, now_s: float) -> None:
        """Looks at one view, if any is new and the last look was long enough ago."""
        versions = {v: version for v in self._views if (version := self._source.version(v)) is not None}
        if core.view_to_look_at(self._seen, versions) is None:
            if now_s - self._looked_s > _RELEASE_S:
                self._backend = None
            return
        if now_s - self._failed_s < _RETRY_S or self._busy():
            return
        try:
            view = self._first_unknown(versions)
            if view is None or now_s - self._looked_s < self._settings.look_period_s:
                return
            if self._backend is None:
                self._backend = self._load()
                self._node.log.info("looks by itself", backend=self._backend.name, views=len(self._views))
            seen = self._perceive(self._backend, view)
        except PerceptionError as error:
            self._failed_s = now_s
            self._node.traffic.reject("own perception")
            self._node.log.warning("the camera can't look by itself", error=str(error), again_in_s=_RETRY_S)
            return
        self._seen[view] = seen
        self._looked_s = time.monotonic()

    def _first_unknown(self, versions: Mapping[int, int]) -> int | None:
        """The next view to look at. What an earlier run saw in a view that shows the same isn't looked at again."""
        self._how = self._how or f"seen by {self._settings.perception} with {models.small_weights()}"
        while (view := core.view_to_look_at(self._seen, versions)) is not None:
            labels = self._kept.get(self._kept.key_of(view, self._how), _labels_of_parts)
            if labels is None:
                return view
            self._seen[view] = core.Seen(versions[view], labels)
        return None

    def _perceive(self, backend: Backend, view: int) -> core.Seen:
        kept_under = self._kept.key_of(view, self._how)
        picture = self._source.latest(view)
        truth = picture.truth if backend.needs_truth else None  # oracle and simulated; a real backend never gets it
        key = (f"camera/{self._source.place.name}", view, picture.version + 1)
        seen = backend.perceive(picture.rgb, picture.depth_m, self._source.intrinsics, truth=truth, key=key)
        labels: dict[str, float] = {}
        for found in seen.detections:
            labels[found.label] = max(float(found.worth), labels.get(found.label, 0.0))
        if not backend.needs_truth:  # who is told the truth depends on more than the picture
            self._kept.put(kept_under, view, self._how, [msgspec.json.encode(labels)])
        return core.Seen(picture.version, labels)

    def _tell(self, now_s: float) -> None:
        """Puts the summary when it is due; nothing before the first look."""
        if not self._seen:
            return
        labels = core.labels_of(self._seen)
        said, said_s = self._said or (None, -math.inf)
        assert CAMERA_SUMMARY.rate_hz is not None
        if core.summary_due(now_s - said_s, news=labels != said, period_s=1.0 / CAMERA_SUMMARY.rate_hz):
            self._said = labels, now_s
            place = self._source.place
            self._publisher.put(core.summary(place.name, place.floor, labels, stamp_ns=clock_ns()))


def _labels_of_parts(parts: Sequence[bytes]) -> dict[str, float]:
    return msgspec.json.decode(parts[0], type=dict[str, float])


def _lower_priority() -> None:
    """Has this thread give way to the rest of the process: on Linux, priority belongs to a thread."""
    if sys.platform == "linux":
        me = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, me, min(19, os.getpriority(os.PRIO_PROCESS, me) + _NICE))
