"""The camera node: says what the camera is, answers requests, and has its views sent while somebody listens."""

from __future__ import annotations

import threading
import time
from typing import Any

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import CAMERA_INFO, CAMERA_REQUEST
from surveilnav.messages import Ack, CameraInfo, StreamStatus
from surveilnav.services.camera_node import messages
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.sources.masked import MaskedSource, hide_mask_zones
from surveilnav.services.camera_node.sources.source import Source
from surveilnav.services.camera_node.view_sender import ViewSender


class CameraService:
    """Publishes the views of one camera, with its mask zones painted over.

    Attributes:
        paused: whether a person has paused the camera: it sends nothing and answers no request for pictures.
    """

    def __init__(self, node: Node, source: Source, settings: CameraSettings, own: OwnPerception | None = None) -> None:
        """``own``: the camera's own perception, for tiers that need it. ConfigError: the tier needs one and has none."""
        source = hide_mask_zones(source, settings)  # applied here, so that no camera can forget it
        self._node, self._source, self._settings = node, source, settings
        if settings.masks:
            zones = source.zones if isinstance(source, MaskedSource) else {}
            node.log.info("mask zones", file=settings.masks, zones_by_view={v: len(z) for v, z in zones.items()})
        place = source.place
        ids: dict[str, Any] = {"floor": place.floor, "camera": place.name}
        self._name = f"camera/{place.name}"
        settings.check_tier()
        self.paused = False
        self._sender = ViewSender(node, source, settings, own, paused=lambda: self.paused)
        self._requested: dict[int, float] = {}  # by view, when it was asked for
        self._lock = threading.Lock()
        node.serve(CAMERA_INFO, lambda _: Answer(self._info()), **ids)
        node.serve(CAMERA_REQUEST, self._on_request, **ids)
        self._infos = node.publisher(CAMERA_INFO, **ids)
        self._announce()

    @property
    def sending(self) -> bool:
        """Whether frames are being sent now; other work of the process should wait."""
        return self._sender.sending

    def step(self) -> bool:
        """One turn of the loop: sends the views that are due. True if there were any."""
        if _announced_of(self._source.stream) != self._announced:
            self._announce()
        with self._lock:
            requested, self._requested = self._requested, {}
        return self._sender.step(requested)

    def _info(self) -> CameraInfo:
        return messages.camera_info(self._source, self._settings, paused=self.paused, now_ns=clock_ns())

    def _announce(self) -> None:
        """Publishes the description of the camera, which also says what its stream is doing."""
        info = self._info()
        self._announced = _announced_of(info.stream)
        self._infos.put(info)

    def _on_request(self, request: Request) -> Answer:
        action, views = request.message.action, request.message.views
        if action in ("pause", "resume"):
            return self._set_paused(action == "pause")
        if self.paused:
            raise Refused("paused", f"{self._name} is paused: a person has it show nothing until it is resumed")
        unknown = set(views) - set(self._sender.views)
        if unknown or not views:
            raise Refused("bad_view", f"expected views of 0-{len(self._sender.views) - 1}, got {views}")
        if action == "order":
            self._sender.order = views
            return Answer(Ack(stamp_ns=clock_ns(), message="the views come in this order"))
        if action == "thumbnail":
            if self._source.version(views[0]) is None:
                raise Refused("busy", f"view {views[0]} has no picture yet: ask again later")
            return Answer(Ack(stamp_ns=clock_ns()), self._sender.encoder.thumbnail(views[0], request.message.width_px))
        with self._lock:
            self._requested |= dict.fromkeys(views, time.monotonic())
        if request.message.pictures:
            self._sender.want_pictures(views)
        self._node.wake.set()
        return Answer(Ack(stamp_ns=clock_ns(), message=f"{len(views)} views will come again"))

    def _set_paused(self, paused: bool) -> Answer:
        if paused != self.paused:
            self.paused = paused
            self._node.log.warning("paused" if paused else "resumed")
            self._announce()
            self._node.wake.set()
        return Answer(Ack(stamp_ns=clock_ns(), message="paused" if paused else "looking"))


def _announced_of(stream: StreamStatus) -> tuple[str, int]:
    """What the camera announces as soon as it changes."""
    return stream.state, stream.n_reconnects
