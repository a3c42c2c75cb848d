from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from surveilnav.cameras_file import CameraEntry
from surveilnav.perception.depth.estimate import DepthEstimate
from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame, StreamError
from surveilnav.services.camera_node.sources.stream import StreamSource
from tests import streams
from tests.waiting import until

ENTRY = {
    "name": "hall",
    "floor": "0",
    "stream": "rtsp://u:hunter2@camera/1",
    "position_m": (1.0, 2.0, 2.6),
    "yaw_deg": 90.0,
    "pitch_deg": -30.0,
    "lens": {"width_px": 320, "height_px": 240, "hfov_deg": 80},
    "max_width_px": 320,
}


class ScriptedReader:
    """A reader that plays what a test gives it: pictures, None, an exception, or "hang"."""

    def __init__(self, script: Iterator[object]) -> None:
        self._script = script
        self.closed = False
        self.bytes_read = 0

    def open(self) -> None:
        pass

    def read(self) -> CapturedFrame | None:
        time.sleep(0.01)
        step = next(self._script, None)
        if isinstance(step, Exception):
            raise step
        if isinstance(step, np.ndarray):
            self.bytes_read += 1000
            return CapturedFrame(step, time.time_ns(), "arrival")
        if step == "hang":
            threading.Event().wait()
        return step  # type: ignore[return-value]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def start() -> Iterator[Callable[..., StreamSource]]:
    sources: list[StreamSource] = []

    def make(
        *scripts: list[object], log: list[str] | None = None, network: object = None, **entry: object
    ) -> StreamSource:
        readers = iter([ScriptedReader(iter(script)) for script in scripts])
        last = ScriptedReader(iter([]))
        source = StreamSource(
            CameraEntry.model_validate({**ENTRY, **entry}),
            0.0,
            lambda: next(readers, last),
            log=(log if log is not None else []).append,
            depth_estimator=network,  # type: ignore[arg-type]
        )
        sources.append(source)
        source.start()
        return source

    yield make
    for source in sources:
        source.close()


def test_pictures_become_versions_and_views(start) -> None:  # type: ignore[no-untyped-def]
    source = start([streams.room(1)])
    assert until(lambda: source.version(0)) == 1
    picture = source.latest(0)
    assert picture.rgb.shape == (240, 320, 3)
    assert (picture.depth_source, picture.depth_m.any(), picture.clock) == ("none", False, "arrival")
    assert abs(picture.captured_ns - time.time_ns()) < 5e9
    assert float(np.abs(picture.rgb.astype(float) - streams.room(1)).mean()) < 3.0  # this lens distorts nothing
    assert (source.place.name, source.place.mounting_offset_m) == ("hall", 2.6)
    assert source.latest(0) is picture


def test_only_what_changed_is_a_new_version(start) -> None:  # type: ignore[no-untyped-def]
    other = streams.room(50)
    other[100:200, 200:300] = 20
    source = start([*(streams.room(t) for t in range(20)), other])
    until(lambda: source.health.n_frames == 21)
    assert source.version(0) == 2


def test_zones_are_black_before_anything_else_gets_the_picture(start) -> None:  # type: ignore[no-untyped-def]
    source = start([streams.room(1)], zones=[[(0, 0), (0.5, 0), (0.5, 1), (0, 1)]])
    until(lambda: source.version(0))
    assert (source.latest(0).rgb[:, :160] == 0).all()
    assert source.latest(0).rgb[:, 165:].mean() > 50


def test_a_stream_that_fails_is_named_and_opened_anew(start) -> None:  # type: ignore[no-untyped-def]
    log: list[str] = []
    source = start([streams.room(1), StreamError("the stream has ended")], [streams.room(2)], log=log)
    until(lambda: source.health.state == "failed")
    assert source.version(0) is None
    until(lambda: source.version(0) == 2, timeout_s=15.0)
    until(lambda: len(log) == 2)
    assert log[0] == "the stream is lost: failed, the stream has ended"
    assert log[1].startswith("the stream is back after")
    assert source.stream.n_bytes == 2000, "what came before the loss is counted, too"


def test_a_fault_of_a_decoder_ends_nothing_and_tells_no_address(start) -> None:  # type: ignore[no-untyped-def]
    log: list[str] = []
    source = start([RuntimeError("rtsp://u:hunter2@camera/1")], log=log)
    until(lambda: log)
    assert source.health.reason == "RuntimeError in the decoder"
    assert "hunter2" not in " ".join(log)


def test_pictures_of_another_size_are_refused(start) -> None:  # type: ignore[no-untyped-def]
    source = start([streams.room(1, (640, 480))])
    until(lambda: source.health.state == "failed")
    assert "its pictures have 640x480 pixels, but its lens is given for 320x240" in source.health.reason


def test_old_pictures_are_no_new_ones(start) -> None:  # type: ignore[no-untyped-def]
    old = CapturedFrame(streams.room(1), time.time_ns() - int(6e9), "file")
    source = start([old, old])
    time.sleep(0.3)
    assert source.version(0) is None
    assert source.health.n_frames == 0


def test_a_reader_that_hangs_harms_nobody(start, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    from surveilnav.services.camera_node.core import stream_health

    monkeypatch.setattr(stream_health, "NO_FRAMES_S", 0.5)
    source = start([streams.room(1), "hang"], [streams.room(2)])
    until(lambda: source.health.state == "no_frames")
    until(lambda: source.version(0) == 2, timeout_s=15.0)


def test_a_stream_without_a_picture_has_no_version(start, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    source = start([])
    assert source.version(0) is None
    with pytest.raises(LookupError):
        source.latest(0)


class ScriptedNetwork:
    """A depth network that finds everything at two metres, and is unsure of the right half."""

    def estimate(self, rgb, camera, T_world_camera, floor_z_m):  # type: ignore[no-untyped-def]
        self.asked = rgb.shape, camera.width_px, T_world_camera[2, 3], floor_z_m
        depth_m, sigma = np.full(rgb.shape[:2], 2.0, np.float32), np.full(rgb.shape[:2], 0.1, np.float32)
        sigma[:, 160:] = 0.5
        return DepthEstimate(depth_m, sigma, np.zeros_like(depth_m))


def test_depth_is_estimated_but_not_in_zones_and_not_where_it_is_unsure(start) -> None:  # type: ignore[no-untyped-def]
    network = ScriptedNetwork()
    source = start([streams.room(1)], network=network, zones=[[(0, 0), (0.25, 0), (0.25, 1), (0, 1)]])
    until(lambda: source.version(0))
    picture = source.latest(0)
    assert (source.has_depth, picture.depth_source) == (True, "network")
    assert picture.depth_uncertainty.sigma == pytest.approx(0.1)
    assert (picture.depth_m[:, 85:160] == 2.0).all()
    assert not picture.depth_m[:, :80].any()
    assert not picture.depth_m[:, 160:].any()
    assert network.asked == ((240, 320, 3), 320, 2.6, 0.0)


def test_a_camera_that_was_turned_is_named_and_sends_nothing_more(start) -> None:  # type: ignore[no-untyped-def]
    from surveilnav.services.camera_node.core import shift

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shift, "_PERIOD_S", 0.0)
        source = start([streams.room(t) for t in range(20)] + [np.roll(streams.room(t), 25, axis=1) for t in range(60)])
        until(lambda: source.health.state == "moved")
    assert source.version(0) is None
    assert "calibrate it anew" in source.health.reason
