"""Subscriptions to sources: to all robots, to the cameras that eq. 1 invokes and, by a setting, to others in advance.

Subscribing to a camera's frames invokes it: a camera renders, encodes and sends only while somebody subscribes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import msgspec

from surveilnav.bus import LatestMessage, Node, Received, bound_request_id, clock_ns
from surveilnav.contract import CAMERA_FRAME, CAMERA_INFO, CAMERA_REQUEST, MAP_REVISION, ROBOT_STATUS
from surveilnav.errors import BusError
from surveilnav.messages import PERCEIVED_TIERS, CameraInfo, CameraRequest, FrameHeader
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.views.invocation import Invocation, invoke
from surveilnav.services.fusion.intake.camera_searches import CameraSearches
from surveilnav.services.fusion.intake.clocks import SourceClocks
from surveilnav.services.fusion.intake.observations import RobotObservations
from surveilnav.services.fusion.intake.ranking import ViewRanking
from surveilnav.services.fusion.intake.robot_positions import too_tall
from surveilnav.services.fusion.intake.wanted_pictures import WantedPictures
from surveilnav.services.fusion.intake.words import SearchedWords
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.shard import Shard

_MAX_CAMERAS, _MAX_VIEWS, _MAX_ROBOTS = 1000, 64, 64
_MAX_SEQ, _MAX_STAMP_NS = 2**53, 2**62  # the largest that the store, the maps and JavaScript clients can represent
_REFRESH_S = 0.1
_ORDER_S = 1.0


@dataclass(slots=True)
class InvokedCamera:
    """A camera whose frames are subscribed to.

    Attributes:
        resend_at_s: when views that haven't arrived are requested again.
        patience_s: time until the next such request; it doubles each time.
        is_silent: whether the camera neither sends nor answers, so that nobody should wait for its views.
        pictures_at_s: when it is asked (again) for the pictures of views that it only told about; ``pictures_patience_s``: as
            ``patience_s``.
        gives_no_pictures: whether it didn't answer that.
        ordered_at_s: when it was last told in which order it should send what its budget makes wait.
    """

    info: CameraInfo
    slots: dict[int, LatestMessage[FrameHeader]]
    arrived: set[int] = field(default_factory=set)
    resend_at_s: float = 0.0
    patience_s: float = 0.0
    is_silent: bool = False
    pictures_at_s: float = 0.0
    pictures_patience_s: float = 0.0
    gives_no_pictures: bool = False
    ordered_at_s: float = 0.0


class Sources:
    """Subscribes to the sources that eq. 1 demands, and returns the newest frame of each subscription."""

    def __init__(
        self,
        node: Node,
        settings: FusionSettings,
        maps: BuildingMaps,
        shard: Shard,
        words: SearchedWords,
        searches: CameraSearches,
        ranking: ViewRanking,
        wanted: WantedPictures,
    ) -> None:
        self._ranking, self._wanted = ranking, wanted
        self._node, self._settings, self._maps, self._words, self._searches = node, settings, maps, words, searches
        self._shard = shard
        self._config = maps.joint.config.map
        self._infos = node.table(CAMERA_INFO)
        self._statuses = node.table(ROBOT_STATUS)
        node.alive("robot")  # the first call starts to follow presence
        self._robots = RobotObservations(node)
        self._present_robots: set[str] = set()
        self._newest = {robot: (last.seq, last.stamp_ns) for robot, last in maps.processed.robots.items()}
        self._invocation, self._clocks = Invocation(), SourceClocks()
        self._silent_prefetched: set[str] = set()
        self._floor_z_m: dict[str, float] = {}
        self._refreshed_s = 0.0
        self.cameras: dict[str, InvokedCamera] = {}

    def infos(self) -> list[CameraInfo]:
        """The shard's cameras that have announced themselves."""
        infos = [row.message for row in self._infos.rows() if row.ids["camera"] == row.message.camera]
        return [info for info in infos if self._shard.includes(info.floor)]

    def poll(self) -> tuple[list[Received[FrameHeader]], list[str]]:
        """The new frames, those of robots first, and the cameras ("camera/<id>") whose subscriptions have just been ended."""
        now_s = time.monotonic()
        dropped: list[str] = []
        if now_s - self._refreshed_s >= _REFRESH_S:
            self._refreshed_s = now_s
            self._follow_robots()
            dropped = self._invoke(now_s)
            self._request_missing(now_s)
            self._request_pictures(now_s)
            self._order_views(now_s)
        return [*self._robot_frames(), *self._camera_frames()], dropped

    def withdraw(self, removal: Removal) -> None:
        """Drops frames of a camera that have arrived and haven't been polled. It is asked for them again at the end."""
        for name, camera in self.cameras.items():
            if removal.source == f"camera/{name}":
                for slot in camera.slots.values():
                    slot.poll()

    def request_again(self, source: str) -> None:
        """Has a camera send all its views again, because the maps don't hold them any more."""
        kind, _, name = source.partition("/")
        if kind == "camera" and name in self.cameras:
            camera = self.cameras[name]
            camera.arrived.clear()
            camera.patience_s, camera.resend_at_s = self._settings.resend_after_s, 0.0
        self._silent_prefetched.discard(name)

    def _follow_robots(self) -> None:
        rows = self._statuses.rows(max_age_s=self._settings.robot_timeout_s)
        elsewhere = {row.ids["robot"] for row in rows if not self._shard.includes(row.message.floor)}
        here = {row.ids["robot"] for row in rows} - elsewhere
        statuses = [row.message for row in rows if row.ids["robot"] in here]
        self._node.report_problem("robot_height", too_tall(statuses, self._config.obstacle_max_m))
        # silent and off the bus, or on the floor of another shard: it needs no place here
        for robot in sorted((set(self._robots) - here - self._node.alive("robot")) | (set(self._robots) & elsewhere)):
            self._robots.forget(robot)
            self._floor_z_m.pop(robot, None)
            self._newest.pop(robot, None)
            self._node.log.info("forgets a robot", robot=robot)
        for robot in sorted(here):
            if robot not in self._robots and len(self._robots) < _MAX_ROBOTS:
                self._robots.follow(robot)
                self._node.log.info("follows a robot", robot=robot)
        present = self._node.alive("robot")
        self._robots.began_anew(present - self._present_robots)
        self._present_robots = set(present)
        newest = {robot: seq for robot, (seq, _) in self._newest.items()}
        self._robots.ask_for_lost({row.ids["robot"]: row for row in rows if row.ids["robot"] in here}, newest)

    def _robot_frames(self) -> list[Received[FrameHeader]]:
        frames = []
        for robot, frame in self._robots.poll():
            if not self._belongs(frame, f"robot/{robot}", 0):
                continue
            if not self._shard.includes(frame.message.floor):
                continue  # it has just come from another shard's floor, or has just left this one's
            header = frame.message
            self._floor_z_m[robot] = header.T_world_camera.translation_m[2] - header.mounting_offset_m
            # an observation that was asked for may have come meanwhile; after a restart a robot numbers anew
            if (header.seq, header.stamp_ns) != self._newest.get(robot):
                self._newest[robot] = header.seq, header.stamp_ns
                with bound_request_id(frame.request_id):
                    frames.append(self._by_our_clock(frame))
                    if frame.request_id:
                        self._node.log_once("takes in a mission's views", robot=robot)
        return frames

    def _camera_frames(self) -> list[Received[FrameHeader]]:
        frames = []
        for name, camera in self.cameras.items():
            for view, slot in camera.slots.items():
                frame = slot.poll()
                if frame is not None and self._belongs(frame, f"camera/{name}", view):
                    camera.arrived.add(view)
                    camera.is_silent = False
                    if frame.message.tier not in PERCEIVED_TIERS:
                        camera.gives_no_pictures = False
                        self._wanted.came((f"camera/{name}", view))
                    camera.resend_at_s = time.monotonic() + self._settings.resend_after_s
                    frames.append(self._by_our_clock(frame))
        return frames

    def _by_our_clock(self, frame: Received[FrameHeader]) -> Received[FrameHeader]:
        """The frame with its time of capture corrected, if its source's clock is ahead by more than a second."""
        header = frame.message
        stamp_ns = self._clocks.corrected_ns(header.source, header.stamp_ns, clock_ns())
        if stamp_ns == header.stamp_ns:
            return frame
        ahead_s = round((header.stamp_ns - stamp_ns) / 1e9, 1)
        self._node.warn_seldom("a clock is ahead, its times aren't believed", source=header.source, ahead_s=ahead_s)
        return replace(frame, message=msgspec.structs.replace(header, stamp_ns=stamp_ns))

    def _belongs(self, frame: Received[FrameHeader], source: str, view: int) -> bool:
        """Whether a frame's header agrees with its key, and its floor and numbers can be stored."""
        header = frame.message
        if not (0 <= header.seq < _MAX_SEQ and 0 <= header.stamp_ns < _MAX_STAMP_NS):
            got = f"seq {header.seq}, stamp_ns {header.stamp_ns}"
            self._node.reject(
                "frame.bad_number", f"expected numbers below 2^53 and 2^62, {source} view {view} says {got}"
            )
            return False
        try:
            self._node.key(MAP_REVISION, floor=header.floor)
        except ValueError as error:
            self._node.reject("frame header", f"floor {header.floor!r:.80}: {error}")
            return False
        if (header.source, header.view) != (source, view):
            got = f"{header.source!r:.80} view {header.view}"
            self._node.reject("frame header", f"expected {source} view {view}, its header says {got}")
            return False
        return True

    def wrong_intrinsics(self, header: FrameHeader) -> str:
        """Why a frame doesn't match the intrinsics that its camera has announced; "" if it does."""
        kind, _, name = header.source.partition("/")
        camera = self.cameras.get(name) if kind == "camera" else None
        if camera is None or header.camera == camera.info.intrinsics:
            return ""
        return f"wrong_intrinsics: the camera says {camera.info.intrinsics}, its frame {header.camera}"

    def _invoke(self, now_s: float) -> list[str]:
        """Eq. 1 with hysteresis: subscribes to the cameras on the floors of robots and of searches, and later unsubscribes."""
        if not self._settings.surveillance:
            return []
        here = {row.ids["robot"] for row in self._statuses.rows(max_age_s=self._settings.robot_timeout_s)}
        infos = {info.camera: info for info in self.infos()}
        floors_z_m = [z_m for robot, z_m in self._floor_z_m.items() if robot in here]
        searched = [info for info in infos.values() if self._searches.includes(info.floor)]
        floors_z_m += {info.position_m[2] - info.mounting_offset_m for info in searched}
        self._invocation = invoke(
            self._invocation,
            floors_z_m,
            infos.values(),
            now_s,
            tau_z_m=self._config.tau_z_m,
            release_z_m=self._config.release_z_m,
            linger_s=self._settings.linger_s,
        )
        active = [*self._invocation.active, *self._prefetched(infos)]
        for name in active:
            if name not in infos:  # it lingers, but its announcement is gone
                continue
            if name in self.cameras:
                self.cameras[name].info = infos[name]
            elif len(self.cameras) < _MAX_CAMERAS:
                self._subscribe(infos[name], now_s)
        gone = sorted(set(self.cameras) - set(active))
        for name in gone:
            for slot in self.cameras.pop(name).slots.values():
                slot.close()
            self._wanted.forget(f"camera/{name}")
            self._node.log.info("releases a camera", camera=name)
        return [f"camera/{name}" for name in gone]

    def _prefetched(self, infos: Mapping[str, CameraInfo]) -> list[str]:
        """The next few cameras without a robot near by whose views the maps lack, while no mission is open."""
        if not self._settings.prefetch_cameras or not self._words.is_idle:
            return []
        near = set(self._invocation.active)
        self._silent_prefetched |= {n for n, camera in self.cameras.items() if camera.is_silent and n not in near}
        others = sorted(set(infos) - near - self._silent_prefetched)
        processed = self._maps.processed
        lacking = [n for n in others if not {view.view for view in infos[n].views} <= processed.views_of(n)]
        return lacking[: self._settings.prefetch_cameras]

    def _subscribe(self, info: CameraInfo, now_s: float) -> None:
        try:
            views = sorted({v.view for v in info.views})
            if any(not 0 <= view < _MAX_VIEWS for view in views):
                raise ValueError(f"{info.camera}: expected views from 0 to {_MAX_VIEWS - 1}, got {views[:99]}")
            ids = {"floor": info.floor, "camera": info.camera}
            slots = {view: self._node.latest(CAMERA_FRAME, **ids, view=view) for view in views}
        except ValueError as error:
            self._node.reject("camera_info", str(error))
            return
        patience_s = self._settings.resend_after_s
        self.cameras[info.camera] = InvokedCamera(info, slots, resend_at_s=now_s + patience_s, patience_s=patience_s)
        self._node.log.info("invokes a camera", camera=info.camera, views=len(slots))

    def _request_missing(self, now_s: float) -> None:
        """Requests views that haven't arrived from their cameras again. The time between two requests doubles each time."""
        for name, camera in self.cameras.items():
            missing = sorted(set(camera.slots) - camera.arrived)
            if not missing or now_s < camera.resend_at_s:
                continue
            camera.patience_s = min(2 * camera.patience_s, 60.0)
            camera.resend_at_s = now_s + camera.patience_s
            request = CameraRequest(stamp_ns=clock_ns(), action="resend", views=missing)
            threading.Thread(target=self._ask, args=(camera, request), name=f"resend-{name}", daemon=True).start()

    def _request_pictures(self, now_s: float) -> None:
        """Requests the pictures of views from cameras that sent what they see themselves, where that isn't enough."""
        for name, views in self._wanted.by_camera().items():
            camera = self.cameras.get(name)
            if camera is None or now_s < camera.pictures_at_s:
                continue
            camera.pictures_patience_s = min(2 * camera.pictures_patience_s or self._settings.resend_after_s, 60.0)
            camera.pictures_at_s = now_s + camera.pictures_patience_s
            self._node.log.info("wants pictures of a camera that looks by itself", camera=name, views=len(views))
            request = CameraRequest(stamp_ns=clock_ns(), action="resend", views=views, pictures=True)
            threading.Thread(target=self._ask, args=(camera, request), name=f"pictures-{name}", daemon=True).start()

    def _order_views(self, now_s: float) -> None:
        """Tells cameras with a budget which of their views may show most now, while more than one is missing."""
        for name, camera in self.cameras.items():
            is_due = camera.info.budget_bytes_s > 0 and now_s - camera.ordered_at_s >= _ORDER_S
            if not is_due or len(set(camera.slots) - camera.arrived) < 2:
                continue
            camera.ordered_at_s = now_s
            request = CameraRequest(stamp_ns=clock_ns(), action="order", views=self._ranking.order(camera.info))
            threading.Thread(target=self._ask, args=(camera, request), name=f"order-{name}", daemon=True).start()

    def _ask(self, camera: InvokedCamera, request: CameraRequest) -> None:
        info = camera.info
        try:
            self._node.ask(CAMERA_REQUEST, request, floor=info.floor, camera=info.camera)
        except BusError as error:
            camera.gives_no_pictures |= request.pictures
            camera.is_silent |= request.action == "resend" and not request.pictures
            self._node.warn_seldom(
                "a camera doesn't send", camera=info.camera, views=len(request.views), error=str(error)
            )
