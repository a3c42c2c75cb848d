"""A real camera: its stream is read on a thread of its own, and undistorted views are made of the newest picture."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.cameras_file import CameraEntry
from surveilnav.cameras_file.views import views_of
from surveilnav.geometry import Pose
from surveilnav.geometry.polygon import pixels_in
from surveilnav.messages import StreamStatus
from surveilnav.perception.depth import DepthEstimator
from surveilnav.services.camera_node.core.change import ChangeDetector
from surveilnav.services.camera_node.core.shift import ShiftDetector
from surveilnav.services.camera_node.core.stream_health import FrameStatistics, StreamHealth
from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame, FrameReader, StreamError
from surveilnav.services.camera_node.sources.source import Picture, Place

#: A picture is sent anew after this time even if nothing has changed, so that others know that the camera still sees.
REFRESH_S = 600.0
_TICK_S = 0.5
#: Threads that hang in a decoder can't be ended. So many are left behind before no more are started.
_MAX_HANGING = 3


class StreamSource:
    """A ``Source``: one camera of cameras.yaml. ``start`` begins to read; ``close`` ends it.

    Args:
        entry: the camera.
        floor_z_m: altitude of its floor in the building's frame.
        make_reader: makes a new reader of its stream.
        max_age_s: older pictures don't count.
        depth_estimator: estimates the views' depth; None: they have none.
        log: gets one line when the stream is lost and one when it is back.

    Raises:
        ValueError: its lens sees too little of every view.
    """

    depth_range_m = (0.1, 100.0)

    def __init__(
        self,
        entry: CameraEntry,
        floor_z_m: float,
        make_reader: Callable[[], FrameReader],
        max_age_s: float = 5.0,
        log: Callable[[str], None] = lambda _: None,
        depth_estimator: DepthEstimator | None = None,
    ) -> None:
        self.has_depth = depth_estimator is not None
        self._depth_estimator, self._floor_z_m = depth_estimator, floor_z_m
        made = views_of(entry)
        self.place = Place(entry.name, entry.floor, entry.position_m, entry.position_m[2] - floor_z_m, entry.label)
        self.views: Sequence[Pose] = made.poses
        self.intrinsics, self._undistortions = made.intrinsics, made.undistortions
        self._make_reader, self._max_age_s, self._log = make_reader, max_age_s, log
        self._size_px = entry.lens.width_px, entry.lens.height_px
        self._zones = pixels_in(entry.zones, *self._size_px)
        self._changes = ChangeDetector()
        self._shift = ShiftDetector(entry.lens.lens().hfov_rad)
        self._health = StreamHealth()
        self._lock = threading.Lock()
        self._newest: CapturedFrame | None = None
        self._version = 0
        self._sent_s = -1e18
        self._pictures: dict[int, Picture] = {}
        self._reading: threading.Thread | None = None
        self._reader: FrameReader | None = None
        self._bytes_before = 0  # that readers before this one have read
        self._hanging: list[threading.Thread] = []
        self._closing = threading.Event()
        self._watching = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def start(self) -> None:
        """Begins to read the stream."""
        self._health.open(time.monotonic())
        self._open_anew()
        self._watching.start()

    def close(self) -> None:
        """Ends reading. A decoder that hangs is left behind."""
        self._closing.set()
        if self._watching.is_alive():
            self._watching.join(2.0)
        if self._reading is not None:
            self._reading.join(2.0)

    @property
    def stream(self) -> StreamStatus:
        """What the stream is doing."""
        health = self.health
        since_ns = time.time_ns() - int((time.monotonic() - health.since_s) * 1e9)
        n_bytes = self._bytes_before + (self._reader.bytes_read if self._reader else 0)
        return StreamStatus(health.state, health.reason, since_ns, health.n_reconnects, n_bytes)

    @property
    def health(self) -> StreamHealth:
        """A copy of the state of the stream."""
        with self._lock:
            return replace(self._health)

    def version(self, view: int) -> int | None:
        """The number of pictures that were worth sending so far; None before the first, and while the stream is lost."""
        return self._version if self._version and self._health.state == "live" else None

    def latest(self, view: int) -> Picture:
        """The view that is made of the newest picture that was worth sending."""
        with self._lock:
            frame, version, made = self._newest, self._version, self._pictures.get(view)
        if frame is None:
            raise LookupError("no picture has come yet")
        if made is None or made.version != version:
            made = self._picture(view, frame, version)
            with self._lock:
                self._pictures[view] = made
        return made

    def content(self, view: int) -> str:
        """Empty: the next run will see something else."""
        return ""

    def _picture(self, view: int, frame: CapturedFrame, version: int) -> Picture:
        undistortion = self._undistortions[view]
        rgb = undistortion.picture(frame.rgb)
        if self._depth_estimator is None:
            depth_m = np.zeros(rgb.shape[:2], np.float32)
            return Picture(version, rgb, depth_m, None, frame.captured_ns, frame.clock, depth_source="none")
        T_world_view = self.views[view].matrix()
        estimate = self._depth_estimator.estimate(rgb, self.intrinsics, T_world_view, self._floor_z_m)
        depth_m, uncertainty = estimate.for_maps()
        depth_m[undistortion.mask(self._zones)] = 0.0
        return Picture(version, rgb, depth_m, None, frame.captured_ns, frame.clock, "network", uncertainty)

    # --- the reading thread -------------------------------------------------------------------------------------

    def _open_anew(self) -> None:
        self._bytes_before += self._reader.bytes_read if self._reader else 0
        self._reader = self._make_reader()
        self._reading = threading.Thread(target=self._read, args=(self._reader,), name="stream", daemon=True)
        self._reading.start()

    def _read(self, reader: FrameReader) -> None:
        """Reads until the stream ends, or until another reader has taken over."""
        try:
            reader.open()
            while not self._closing.is_set() and reader is self._reader:
                frame = reader.read()
                if frame is not None and reader is self._reader:
                    self._take(frame)
        except StreamError as error:
            self._fail(reader, str(error))
        except Exception as error:  # a fault of a decoder must not end the camera
            self._fail(reader, f"{type(error).__name__} in the decoder")
        finally:
            reader.close()

    def _take(self, frame: CapturedFrame) -> None:
        height, width = frame.rgb.shape[:2]
        if (width, height) != self._size_px:
            raise StreamError(
                f"its pictures have {width}x{height} pixels, but its lens is given for {self._size_px[0]}x{self._size_px[1]}: "
                "set the camera to that size, or calibrate its lens anew"
            )
        if time.time_ns() - frame.captured_ns > self._max_age_s * 1e9:
            return  # an old picture, such as one that lay in a folder or in a decoder's queue
        statistics = FrameStatistics.from_picture(frame.rgb)
        rgb = self._without_zones(frame.rgb)
        now_s = time.monotonic()
        if not statistics.fault:
            self._shift.observe(frame.rgb, now_s)  # with its zones, whose edges don't move
        with self._lock:
            was_live = self._health.state == "live"
            self._health.frame(now_s, statistics, self._moved())
            if not self._health.usable:
                return
            if self._changes.observe(rgb) or not was_live or now_s - self._sent_s >= REFRESH_S:
                self._changes.sent(rgb)
                self._newest, self._version, self._sent_s = replace(frame, rgb=rgb), self._version + 1, now_s

    def _moved(self) -> str:
        if not self._shift.has_moved:
            return ""
        return f"its picture is shifted by {math.degrees(self._shift.shift_rad):.1f} degrees: calibrate it anew, or turn it back"

    def _without_zones(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if not self._zones.any():
            return rgb
        return np.where(self._zones[..., None], np.uint8(0), rgb)

    def _fail(self, reader: FrameReader, reason: str) -> None:
        with self._lock:
            if reader is self._reader and not self._closing.is_set():
                self._health.failure(time.monotonic(), reason)

    # --- the watchdog -------------------------------------------------------------------------------------------

    def _watch(self) -> None:
        while not self._closing.wait(_TICK_S):
            now_s = time.monotonic()
            with self._lock:
                self._health.tick(now_s)
                due = self._health.reconnect_due(now_s)
                messages = self._health.pop_messages()
            for message in messages:
                self._log(message)
            if due:
                self._reconnect(now_s)

    def _reconnect(self, now_s: float) -> None:
        self._hanging = [thread for thread in (*self._hanging, self._reading) if thread and thread.is_alive()]
        if len(self._hanging) > _MAX_HANGING:
            return
        with self._lock:
            self._health.open(now_s)
        self._open_anew()
