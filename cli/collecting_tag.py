"""``surveilnav cameras calibrate-tag``: drives along with a robot, and collects where its cameras see the tag at each stop."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag import Stop, TagDetector
from surveilnav.camera_pose.tag.stops import Standstill, StandstillDetector, SteadyCorners
from surveilnav.cameras_file import CameraEntry
from surveilnav.client import Client
from surveilnav.errors import ConfigError, GatewayError
from surveilnav.geometry.polygon import pixels_in
from surveilnav.rest import Robot
from surveilnav.services.camera_node.sources.readers.choose import choose_reader
from surveilnav.services.camera_node.sources.readers.reader import FrameReader, StreamError

_ASK_S = 0.25
_PERIOD_S = 0.2
_AGAIN_S = 5.0
_LOST_S = 20.0
_CLOSE_S = 3.0


class CameraWatch:
    """Reads one camera's stream on a thread, and looks for the tag in it while a robot stands.

    Args:
        tell: gets a line when the stream fails, and when it is back.

    Raises:
        ConfigError: nothing can read such an address.
    """

    def __init__(self, entry: CameraEntry, folder: Path, tag_id: int, tell: Callable[[str], None]) -> None:
        self.name = entry.name
        self._size_px = entry.lens.width_px, entry.lens.height_px
        self._zones = pixels_in(entry.zones, *self._size_px)
        self._detector, self._tell = TagDetector(tag_id), tell
        self._make_reader: Callable[[], FrameReader] = lambda: choose_reader(
            entry.stream, folder, os.environ, self._size_px, _PERIOD_S
        )
        self._make_reader()
        self._looking: SteadyCorners | None = None
        self._closing = threading.Event()
        self._fault = ""
        self._thread = threading.Thread(target=self._run, name=f"tag {entry.name}", daemon=True)
        self._thread.start()

    def look(self) -> None:
        """Begins to look for the tag, in pictures that are read from now on."""
        self._looking = SteadyCorners()

    def stop_looking(self) -> NDArray[np.float64] | None:
        """The corners (4, 2) that were found since ``look``, if any."""
        looking, self._looking = self._looking, None
        return looking.corners_px if looking is not None else None

    @property
    def done(self) -> bool:
        """Whether to look on makes no sense: the tag was found, isn't in sight, or the stream has failed."""
        looking = self._looking
        return looking is None or looking.done or bool(self._fault)

    def close(self) -> None:
        """Ends reading; a decoder that hangs is left behind."""
        self._closing.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        while not self._closing.is_set():
            reader = self._make_reader()
            try:
                reader.open()
                while not self._closing.is_set():
                    if frame := reader.read():
                        self._observe(frame.rgb)
            except StreamError as error:
                self._set_fault(str(error))
            except Exception as error:  # a fault of one decoder must not end the others
                self._set_fault(f"{type(error).__name__} in the decoder")
            finally:
                reader.close()
            self._closing.wait(_AGAIN_S)

    def _observe(self, rgb: NDArray[np.uint8]) -> None:
        height, width = rgb.shape[:2]
        if (width, height) != self._size_px:
            raise StreamError(
                f"its pictures have {width}x{height} pixels, but its lens is given for {self._size_px[0]}x{self._size_px[1]}"
            )
        self._set_fault("")
        looking = self._looking
        if looking is not None and not looking.done:
            shown = np.where(self._zones[..., None], np.uint8(0), rgb) if self._zones.any() else rgb
            looking.observe(self._detector.corners(shown))

    def _set_fault(self, fault: str) -> None:
        if fault != self._fault:
            self._fault = fault
            self._tell(f"{self.name}: {fault or 'its stream is back'}")


class RobotWatch:
    """Asks a running system where a robot is, and whether it stands.

    Args:
        robot: its id; empty: the only one that there is.
    """

    def __init__(self, gateway: Client, robot: str) -> None:
        self._gateway, self._robot = gateway, robot
        self._detector = StandstillDetector()
        self._heard_s = time.monotonic()

    def observe(self) -> tuple[Robot | None, Standstill | None]:
        """The robot now, None while it or the gateway is silent, and where it stands if it does.

        Raises:
            GatewayError: the gateway has been silent for 20 s.
            ConfigError: there is no such robot, or it isn't clear which one carries the tag.
        """
        try:
            robots = self._gateway.robots()
        except GatewayError:
            if time.monotonic() - self._heard_s > _LOST_S:
                raise
            return None, None
        now_s = self._heard_s = time.monotonic()
        robot = chosen_robot(robots, self._robot)
        self._robot = robot.id
        if robot.stale:
            return None, None
        x, y, _ = robot.position_m
        return robot, self._detector.observe(now_s, x, y, robot.yaw_rad)


def chosen_robot(robots: Iterable[Robot], id: str) -> Robot:
    """The robot with this id; without an id, the only one that is there.

    Raises:
        ConfigError: there is none, or there are several.
    """
    there = [robot for robot in robots if (robot.id == id if id else not robot.stale)]
    if len(there) == 1:
        return there[0]
    if id:
        raise ConfigError(f"there is no robot {id!r}; there are {', '.join(r.id for r in robots) or 'none'}")
    if not there:
        raise ConfigError("the system has no robot, so none can carry the tag; see `surveilnav status`")
    raise ConfigError(
        f"there are several robots: say which one carries the tag by --robot {' or '.join(r.id for r in there)}"
    )


def collect(
    robot: RobotWatch,
    cameras: dict[str, CameraEntry],
    open_camera: Callable[[CameraEntry], CameraWatch],
    wanted: Callable[[Stop], bool],
    stopping: threading.Event,
    tell: Callable[[str], None],
) -> None:
    """Hands each stop to ``wanted`` when it is over, until that returns False or ``stopping`` is set.

    Only streams of cameras on the robot's floor are read.
    """
    watches: dict[str, CameraWatch] = {}
    current: tuple[float, Stop] | None = None  # begin and place of the stop at which the cameras look
    over_s = -1.0  # begin of the last stop that is over
    try:
        while not stopping.is_set():
            here, still = robot.observe()
            if here is not None:
                _open_floor(watches, here.floor, cameras, open_camera, tell)
            since_s = still.since_s if still else None
            if current is not None and (since_s != current[0] or all(watch.done for watch in watches.values())):
                over_s = current[0]
                if not wanted(_finished(current[1], watches)):
                    return
                current = None
            if here is not None and still is not None and current is None and since_s != over_s:
                current = still.since_s, Stop(here.id, here.floor, still.x_m, still.y_m, still.yaw_rad)
                for watch in watches.values():
                    watch.look()
            stopping.wait(_ASK_S)
        if current is not None:
            wanted(_finished(current[1], watches))
    finally:
        for watch in watches.values():
            watch.close()


def _finished(stop: Stop, watches: dict[str, CameraWatch]) -> Stop:
    for name, watch in watches.items():
        if (corners := watch.stop_looking()) is not None:
            stop.seen[name] = corners
    return stop


def _open_floor(
    watches: dict[str, CameraWatch],
    floor: str,
    cameras: dict[str, CameraEntry],
    open_camera: Callable[[CameraEntry], CameraWatch],
    tell: Callable[[str], None],
) -> None:
    """Opens the streams of a floor's cameras, and closes the others."""
    wanted = {name for name, entry in cameras.items() if entry.floor == floor}
    for name in [name for name in watches if name not in wanted]:
        watches.pop(name).close()
    for name in sorted(wanted - set(watches)):
        tell(f"{name}: reading its stream")
        watches[name] = open_camera(cameras[name])
