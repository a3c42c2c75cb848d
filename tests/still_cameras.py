"""Many cameras in a few processes, each with a bus session of its own: for benchmarks of what cameras cost others."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import time
from collections.abc import Callable, Iterator
from multiprocessing.synchronize import Event

import numpy as np
import zenoh

from surveilnav.bus import BusSettings, Node, clock_ns
from surveilnav.bus.connection import encoding_of
from surveilnav.bus.wire import encode
from surveilnav.contract import CAMERA_SUMMARY, LIVELINESS
from surveilnav.geometry import Matrix4, Pinhole, Pose, camera_pose
from surveilnav.messages import CameraSummary, StreamStatus
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.sources.source import Picture, Place
from tests.world import World

LENS = Pinhole.from_hfov(640, 480, math.radians(90))
RANGE_M = (0.1, 10.0)
SUMMARY_S = 5.0
_PER_PROCESS = 50
_HEIGHT_M = 2.4
_PATIENCE_S = 600.0


class StillSource:
    """A camera that looks down on an empty floor of 6 x 6 m between walls, with a little noise of its own."""

    has_depth = True
    intrinsics, depth_range_m = LENS, RANGE_M

    def __init__(self, number: int, floor: str) -> None:
        x_m, y_m = 6.0 * (number % 15), 6.0 * (number // 15 % 15)
        self.place = Place(f"c{number}", floor, (x_m, y_m, _HEIGHT_M), _HEIGHT_M)
        self._T = camera_pose((x_m, y_m, _HEIGHT_M), 0.0, -0.6)
        self.views = [Pose.from_matrix(self._T)]
        self.stream = StreamStatus()
        self._seed = number

    def version(self, view: int) -> int:
        return 1

    def content(self, view: int) -> str:
        return str(self._seed)

    def latest(self, view: int) -> Picture:
        return Picture(1, *room_from_inside(self._T, self.place.position_m, self._seed))


def room_from_inside(T: Matrix4, at_m: tuple[float, float, float], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth of a room of 6 x 6 x 3 m around a place, with a little noise."""
    x_m, y_m = at_m[:2]
    room = World(room=((x_m - 3.0, y_m - 3.0, 0.0), (x_m + 3.0, y_m + 3.0, 3.0)))
    depth_m, _ = room.depth(T, LENS)
    rng = np.random.default_rng(seed)
    rgb = np.repeat(rng.integers(60, 200, (48, 64, 3), np.uint8), 10, axis=0).repeat(10, axis=1)
    return rgb, (depth_m * (1 + 0.005 * rng.standard_normal(depth_m.shape))).astype(np.float32)


def run_cameras(numbers: range, n_floors: int, step_s: float, bus: BusSettings, ready: Event, stop: Event) -> None:
    """Cameras in one process, each with a session of its own, until ``stop``; their loops turn every ``step_s``."""
    with contextlib.ExitStack() as stack:
        cameras = []
        for number in numbers:
            source = StillSource(number, str(number % n_floors))
            node = stack.enter_context(Node("camera", source.place.name, bus))
            ids = {"floor": source.place.floor, "camera": source.place.name}
            cameras.append((CameraService(node, source, CameraSettings()), node.publisher(CAMERA_SUMMARY, **ids), ids))
        ready.set()
        next_summary_s = time.monotonic()
        while not stop.wait(step_s):
            for service, summary, ids in cameras:
                service.step()
                if time.monotonic() >= next_summary_s:
                    summary.put(CameraSummary(stamp_ns=clock_ns(), labels={"chair": 0.5, "tv": 0.7}, **ids))
            if time.monotonic() >= next_summary_s:
                next_summary_s += SUMMARY_S


def run_sessions(numbers: range, n_floors: int, step_s: float, bus: BusSettings, ready: Event, stop: Event) -> None:
    """Bare sessions in one process that are present and publish summaries, as cameras without anything else to do."""
    sessions, kept = [], []
    for number in numbers:
        ids = {"floor": str(number % n_floors), "camera": f"c{number}"}
        session = _open_patiently(bus)
        token = LIVELINESS.format(building=bus.building, kind="camera", id=ids["camera"])
        kept.append(session.liveliness().declare_token(token))
        publisher = session.declare_publisher(CAMERA_SUMMARY.key_for(building=bus.building, **ids))
        sessions.append((session, publisher, ids))
    ready.set()
    next_s = time.monotonic() + SUMMARY_S * np.arange(len(sessions)) / len(sessions)
    while not stop.wait(step_s):
        for k in np.nonzero(next_s <= time.monotonic())[0]:
            _, publisher, ids = sessions[k]
            message = CameraSummary(stamp_ns=clock_ns(), labels={"chair": 0.5, "tv": 0.7}, **ids)
            publisher.put(encode(message), encoding=encoding_of(CameraSummary))
            next_s[k] += SUMMARY_S
    for session, _, _ in sessions:
        session.close()


def _open_patiently(bus: BusSettings) -> zenoh.Session:
    """A session. While a thousand are opened on one machine, the router's answer to one may come after Zenoh's time limit."""
    for _ in range(10):
        with contextlib.suppress(zenoh.ZError):
            return zenoh.open(zenoh.Config.from_json5(bus.client_config()))
    return zenoh.open(zenoh.Config.from_json5(bus.client_config()))


@contextlib.contextmanager
def cameras(
    n: int, n_floors: int, bus: BusSettings, step_s: float = 0.1, run: Callable[..., None] = run_cameras
) -> Iterator[list[int]]:
    """Runs cameras c0, c1, …, distributed to the floors "0", "1", …; yields the ids of their processes.

    ``run``: ``run_cameras``, or ``run_sessions`` for bare sessions, which need no threads of Python.
    """
    per_process = 250 if run is run_sessions else _PER_PROCESS
    context = multiprocessing.get_context("spawn")
    stop, processes = context.Event(), []
    for first in range(0, n, per_process):
        ready = context.Event()
        numbers = range(first, min(first + per_process, n))
        processes.append(context.Process(target=run, args=(numbers, n_floors, step_s, bus, ready, stop)))
        processes[-1].start()
        if not ready.wait(_PATIENCE_S):
            raise SystemExit(f"cameras {numbers} didn't start within {_PATIENCE_S:.0f} s")
    try:
        yield [process.pid for process in processes if process.pid]
    finally:
        stop.set()
        for process in processes:
            process.join(30)
            process.kill()
