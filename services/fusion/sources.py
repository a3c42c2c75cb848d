"""Who is looked through: robots always, cameras while eq. 1 invokes them, others ahead if a setting allows. Invocation is
subscription."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from surveilnav.bus import LatestMessage, Node, Received, clock_ns
from surveilnav.contract import CAMERA_FRAME, CAMERA_INFO, CAMERA_REQUEST, MAP_REVISION, ROBOT_OBSERVATION, ROBOT_STATUS
from surveilnav.errors import BusError
from surveilnav.messages import CameraInfo, CameraRequest, FrameHeader
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import MapConfig
from surveilnav.services.fusion.core.invocation import Invocation, invoke
from surveilnav.services.fusion.records import LastObservation

_MAX_CAMERAS, _MAX_VIEWS, _MAX_ROBOTS = 1000, 64, 64
_MAX_SEQ, _MAX_STAMP_NS = 2**53, 2**62  # beyond, no store, map or reader in JavaScript can hold it
_REFRESH_S = 0.1


@dataclass(slots=True)
class InvokedCamera:
    """A camera that is listened to: one slot a view, and which of them have come."""

    info: CameraInfo
    slots: dict[int, LatestMessage[FrameHeader]]
    arrived: set[int] = field(default_factory=set)
    ask_again_s: float = 0.0
    patience_s: float = 0.0
    silent: bool = False  # it neither sends nor answers: nobody should wait for its views


class Sources:
    """Keeps the subscriptions as eq. 1 wants them and hands over the newest frame of each."""

    def __init__(
        self,
        node: Node,
        settings: FusionSettings,
        config: MapConfig,
        processed: Mapping[str, LastObservation],
        views_of: Callable[[str], Collection[int]],
        idle: Callable[[], bool],
    ) -> None:
        """``processed``: the newest observation that is, by robot; ``views_of``: the views that are, of a camera. ``idle``:
        whether nobody searches."""
        self._node, self._settings, self._config = node, settings, config
        self._infos = node.table(CAMERA_INFO)
        self._statuses = node.table(ROBOT_STATUS)
        node.alive("robot")  # the first call starts watching
        self._robots: dict[str, LatestMessage[FrameHeader]] = {}
        self._views_of, self._idle = views_of, idle
        self._silent_ahead: set[str] = set()
        self._newest = {robot: (h.seq, h.stamp_ns) for robot, h in processed.items()}
        self._invocation = Invocation()
        self._floor_z_m: dict[str, float] = {}
        self._refreshed_s = 0.0
        self.cameras: dict[str, InvokedCamera] = {}

    def poll(self) -> tuple[list[Received[FrameHeader]], list[str]]:
        """New frames, robots' first, and the sources ("camera/<id>") that are no longer listened to."""
        now_s = time.monotonic()
        dropped: list[str] = []
        if now_s - self._refreshed_s >= _REFRESH_S:
            self._refreshed_s = now_s
            self._follow_robots()
            dropped = self._invoke(now_s)
            self._ask_again(now_s)
        return [*self._robot_frames(), *self._camera_frames()], dropped

    def _follow_robots(self) -> None:
        here = {row.ids["robot"] for row in self._statuses.rows(max_age_s=self._settings.robot_timeout_s)}
        for robot in sorted(set(self._robots) - here - self._node.alive("robot")):  # silent and gone: its place is free
            self._robots.pop(robot).close()
            self._floor_z_m.pop(robot, None)
            self._newest.pop(robot, None)
            self._node.log.info("forgets a robot", robot=robot)
        for robot in sorted(here):
            if robot not in self._robots and len(self._robots) < _MAX_ROBOTS:
                self._robots[robot] = self._node.latest(ROBOT_OBSERVATION, robot=robot)
                self._node.log.info("follows a robot", robot=robot)

    def _robot_frames(self) -> list[Received[FrameHeader]]:
        frames = []
        for robot, slot in self._robots.items():
            frame = slot.poll()
            if frame is None or not self._belongs(frame, f"robot/{robot}", 0):
                continue
            header = frame.message
            self._floor_z_m[robot] = header.T_world_camera.translation_m[2] - header.mounting_offset_m
            # a robot repeats what nobody followed up; one that was restarted counts anew
            if (header.seq, header.stamp_ns) != self._newest.get(robot):
                self._newest[robot] = header.seq, header.stamp_ns
                frames.append(frame)
        return frames

    def _camera_frames(self) -> list[Received[FrameHeader]]:
        frames = []
        for name, camera in self.cameras.items():
            for view, slot in camera.slots.items():
                frame = slot.poll()
                if frame is not None and self._belongs(frame, f"camera/{name}", view):
                    camera.arrived.add(view)
                    camera.silent = False
                    camera.ask_again_s = time.monotonic() + self._settings.resend_after_s
                    frames.append(frame)
        return frames

    def _belongs(self, frame: Received[FrameHeader], source: str, view: int) -> bool:
        """Whether a frame says of itself what its key says, and its floor and numbers are such as can be kept."""
        header = frame.message
        if not (0 <= header.seq < _MAX_SEQ and 0 <= header.stamp_ns < _MAX_STAMP_NS):
            said = f"seq {header.seq}, stamp_ns {header.stamp_ns}"
            self._node.reject(
                "frame.bad_number", f"expected numbers below 2^53 and 2^62, {source} view {view} says {said}"
            )
            return False
        try:
            self._node.key(MAP_REVISION, floor=header.floor)
        except ValueError as error:
            self._node.reject("frame header", f"floor {header.floor!r:.80}: {error}")
            return False
        if (header.source, header.view) != (source, view):
            said = f"{header.source!r:.80} view {header.view}"
            self._node.reject("frame header", f"expected {source} view {view}, its header says {said}")
            return False
        return True

    def wrong_intrinsics(self, header: FrameHeader) -> str:
        """Why a camera's frame can't be what its camera says of itself; "" if it can."""
        kind, _, name = header.source.partition("/")
        camera = self.cameras.get(name) if kind == "camera" else None
        if camera is None or header.camera == camera.info.intrinsics:
            return ""
        return f"wrong_intrinsics: the camera says {camera.info.intrinsics}, its frame {header.camera}"

    def _invoke(self, now_s: float) -> list[str]:
        """Eq. 1: listens to the cameras on the robots' floors; lets go of others after a while."""
        if not self._settings.surveillance:
            return []
        here = {row.ids["robot"] for row in self._statuses.rows(max_age_s=self._settings.robot_timeout_s)}
        infos = {
            row.ids["camera"]: row.message for row in self._infos.rows() if row.ids["camera"] == row.message.camera
        }
        floors_z_m = [z_m for robot, z_m in self._floor_z_m.items() if robot in here]
        self._invocation = invoke(
            self._invocation,
            floors_z_m,
            infos.values(),
            now_s,
            tau_z_m=self._config.tau_z_m,
            release_z_m=self._config.release_z_m,
            linger_s=self._settings.linger_s,
        )
        active = [*self._invocation.active, *self._ahead(infos)]
        for name in active:
            if name not in infos:  # it lingers: nobody says of it any more what it is
                continue
            if name in self.cameras:
                self.cameras[name].info = infos[name]
            elif len(self.cameras) < _MAX_CAMERAS:
                self._listen(infos[name], now_s)
        gone = sorted(set(self.cameras) - set(active))
        for name in gone:
            for slot in self.cameras.pop(name).slots.values():
                slot.close()
            self._node.log.info("releases a camera", camera=name)
        return [f"camera/{name}" for name in gone]

    def _ahead(self, infos: Mapping[str, CameraInfo]) -> list[str]:
        """A few cameras that no robot is near and that the maps lack views of, while nobody searches and a setting allows."""
        if not self._settings.ahead_cameras or not self._idle():
            return []
        near = set(self._invocation.active)
        self._silent_ahead |= {name for name, camera in self.cameras.items() if camera.silent and name not in near}
        others = sorted(set(infos) - near - self._silent_ahead)
        lacking = [n for n in others if not {view.view for view in infos[n].views} <= set(self._views_of(n))]
        return lacking[: self._settings.ahead_cameras]

    def _listen(self, info: CameraInfo, now_s: float) -> None:
        try:
            views = sorted({v.view for v in info.views})
            if any(not 0 <= view < _MAX_VIEWS for view in views):
                raise ValueError(f"{info.camera}: expected views from 0 to {_MAX_VIEWS - 1}, got {views[:99]}")
            place = {"floor": info.floor, "camera": info.camera}
            slots = {view: self._node.latest(CAMERA_FRAME, **place, view=view) for view in views}
        except ValueError as error:
            self._node.reject("camera_info", str(error))
            return
        patience_s = self._settings.resend_after_s
        self.cameras[info.camera] = InvokedCamera(info, slots, ask_again_s=now_s + patience_s, patience_s=patience_s)
        self._node.log.info("invokes a camera", camera=info.camera, views=len(slots))

    def _ask_again(self, now_s: float) -> None:
        """Asks cameras for views that were lost on the way; each time waits twice as long."""
        for name, camera in self.cameras.items():
            missing = sorted(set(camera.slots) - camera.arrived)
            if not missing or now_s < camera.ask_again_s:
                continue
            camera.patience_s = min(2 * camera.patience_s, 60.0)
            camera.ask_again_s = now_s + camera.patience_s
            threading.Thread(target=self._request, args=(camera, missing), name=f"resend-{name}", daemon=True).start()

    def _request(self, camera: InvokedCamera, views: list[int]) -> None:
        info, request = camera.info, CameraRequest(stamp_ns=clock_ns(), action="resend", views=views)
        try:
            self._node.ask(CAMERA_REQUEST, request, floor=info.floor, camera=info.camera)
        except BusError as error:
            camera.silent = True
            self._node.warn_seldom("a camera doesn't send", camera=info.camera, views=len(views), error=str(error))
