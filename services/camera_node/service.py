"""The camera node: encodes and publishes a view only while somebody listens to it."""

from __future__ import annotations

import threading
from typing import Any

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import CAMERA_FRAME, CAMERA_INFO, CAMERA_REQUEST, TRUTH
from surveilnav.messages import Ack
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.camera_node import messages
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core import sending
from surveilnav.services.camera_node.frames import FrameEncoder
from surveilnav.services.camera_node.sources.masked import MaskedSource, hide_mask_zones
from surveilnav.services.camera_node.sources.source import Source


class CameraService:
    """Publishes the views of one camera, with its mask zones painted over.

    Attributes:
        sending: whether frames are being sent now; other work of the process should wait.
        paused: whether a person has paused the camera: it sends nothing and answers no request for pictures.
    """

    def __init__(self, node: Node, source: Source, settings: CameraSettings) -> None:
        source = hide_mask_zones(source, settings)  # applied here, so that no camera can forget it
        self._node, self._source = node, source
        if settings.masks:
            zones = source.zones if isinstance(source, MaskedSource) else {}
            node.log.info("mask zones", file=settings.masks, zones_by_view={v: len(z) for v, z in zones.items()})
        place, views = source.place, range(len(source.views))
        ids: dict[str, Any] = {"floor": place.floor, "camera": place.name}
        self._name = f"camera/{place.name}"
        self._frames = {v: node.publisher(CAMERA_FRAME, **ids, view=v) for v in views}
        self._truths = {v: node.publisher(TRUTH, source=f"camera-{place.name}", view=v) for v in views}
        self._encoder = FrameEncoder(source, settings)
        self._send_state = sending.SendState()
        self._requested: set[int] = set()
        self._lock = threading.Lock()
        self.sending = self.paused = False
        self._seq = dict.fromkeys(views, 0)
        node.serve(
            CAMERA_INFO,
            lambda _: Answer(messages.camera_info(self._source, paused=self.paused, now_ns=clock_ns())),
            **ids,
        )
        node.serve(CAMERA_REQUEST, self._on_request, **ids)
        self._infos = node.publisher(CAMERA_INFO, **ids)
        self._announce()

    def step(self) -> bool:
        """One turn of the loop: sends the views that are due. True if there were any."""
        if self._source.stream.state != self._announced:
            self._announce()
        matched = {v for v, publisher in self._frames.items() if publisher.matched}
        with self._lock:
            requested, self._requested = self._requested, set()
        versions = {v: version for v in self._frames if (version := self._source.version(v)) is not None}
        self._send_state, due = sending.views_to_send(
            self._send_state, versions=versions, matched=matched, requested=requested, paused=self.paused
        )
        self.sending = bool(due)
        for view in due:
            if self._node.stopping.is_set():
                break
            self._send(view)
        self.sending = False
        return bool(due)

    def _send(self, view: int) -> None:
        frame = self._encoder.newest(view)
        self._seq[view] += 1
        self._send_truth(view, frame.version)
        header = messages.frame_header(self._source, view, self._seq[view], frame, now_ns=clock_ns())
        self._frames[view].put(header, frame.payload)

    def _send_truth(self, view: int, version: int) -> None:
        """Publishes the instance ids of a simulated view, to which only the backends oracle and simulated ever listen."""
        if not self._truths[view].matched:
            return
        picture = self._source.latest(view)
        if picture.truth is None or picture.version != version:
            return
        truth = truth_to_wire(picture.truth, source=self._name, view=view, seq=self._seq[view], stamp_ns=clock_ns())
        self._truths[view].put(*truth)

    def _announce(self) -> None:
        """Publishes the description of the camera, which also says what its stream is doing."""
        info = messages.camera_info(self._source, paused=self.paused, now_ns=clock_ns())
        self._announced = info.stream.state
        self._infos.put(info)

    def _on_request(self, request: Request) -> Answer:
        action, views = request.message.action, request.message.views
        if action in ("pause", "resume"):
            return self._set_paused(action == "pause")
        if self.paused:
            raise Refused("paused", f"{self._name} is paused: a person has it show nothing until it is resumed")
        unknown = set(views) - set(self._frames)
        if unknown or not views:
            raise Refused("bad_view", f"expected views of 0-{len(self._frames) - 1}, got {views}")
        if action == "thumbnail":
            if self._source.version(views[0]) is None:
                raise Refused("busy", f"view {views[0]} has no picture yet: ask again later")
            return Answer(Ack(stamp_ns=clock_ns()), self._encoder.thumbnail(views[0], request.message.width_px))
        with self._lock:
            self._requested |= set(views)
        self._node.wake.set()
        return Answer(Ack(stamp_ns=clock_ns(), message=f"{len(views)} views will come again"))

    def _set_paused(self, paused: bool) -> Answer:
        if paused != self.paused:
            self.paused = paused
            self._node.log.warning("paused" if paused else "resumed")
            self._announce()
            self._node.wake.set()
        return Answer(Ack(stamp_ns=clock_ns(), message="paused" if paused else "looking"))
