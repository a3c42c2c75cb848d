"""Fusion's maps on a file, without a bus: what a test needs to log, restart and compare them."""

from __future__ import annotations

import threading
from dataclasses import replace

import msgspec
import structlog

from surveilnav.geometry import Pose
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.sensing.packing import decode_frame, encode_rgbd
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.perceived import PerceivedView

RANGE_M = (0.1, 10.0)


class FakeNode:
    """What the maps need of a node: a place to complain to."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.rejected: list[str] = []
        self.stopping, self.wake = threading.Event(), threading.Event()
        self.log = structlog.wrap_logger(None, processors=[self._hear])

    def _hear(self, _, method, event):
        self.said.append(event["event"])
        raise structlog.DropEvent

    def reject(self, where: str, why: str) -> None:
        self.rejected.append(where)

    def warn_seldom(self, event: str, **facts: object) -> None:
        self.said.append(event)


def perceived_view(view: PosedView, seen: ViewPerception, digest: bytes) -> PerceivedView:
    """A view of floor "0" and what perception saw in it, as they come over the bus."""
    payload, image, depth = encode_rgbd(view.rgb, view.depth_m, depth_range_m=RANGE_M)
    header = FrameHeader(
        stamp_ns=view.stamp_ns,
        source=view.source,
        view=0,
        seq=view.seq,
        floor="0",
        camera=view.camera,
        depth_range_m=RANGE_M,
        T_world_camera=Pose.from_matrix(view.T_world_camera),
        mounting_offset_m=view.mounting_offset_m,
        image=image,
        depth=depth,
    )
    detections, embedding = perception_to_wire(seen)
    reply = InferReply(
        stamp_ns=1,
        worker="w",
        backend="b",
        source=view.source,
        view=0,
        seq=view.seq,
        detections=detections,
        image_embedding=embedding,
    )
    return PerceivedView(
        (view.source, 0),
        header,
        decode_frame(header, payload),
        perception_from_wire(reply, view.camera),
        payload,
        msgspec.msgpack.encode(reply),
        digest,
    )


class Run:
    """Fusion's maps on a file, started as often as wanted."""

    def __init__(self, path, tools, **settings) -> None:
        self.path, self.tools = path, tools
        self.settings = settings
        self.world = tools.world(boxes={"sofa": ((3.0, 1.0, 0.0), (4.6, 1.9, 0.8))})
        self.start()

    def start(self, keep_pictures_s=None, **settings) -> BuildingMaps:
        self.node = FakeNode()
        options = {"store": str(self.path), "retry_s": 1e-6} | self.settings | settings
        config = FusionSettings(**options)
        self.maps = BuildingMaps(config.core())
        self.log = MapLog(self.node, config, self.maps, keep_pictures_s)
        return self.maps

    def view(self, seq: int, source: str = "robot/r", x: float = 1.0) -> PerceivedView:
        kind = {"height": 1.8} if source.startswith("camera/") else {}
        v = self.world.view(x + 0.1 * (seq % 20), 2, 0.05 * seq, -0.2, source=source, seq=seq, **kind)
        chair = DetectedObject("couch", 0.6, (20.0, 40.0, 120.0, 110.0), None, self.tools.unit(seq % 3))
        seen = self.tools.seen(chair, image=self.tools.unit(seq % 4))
        return perceived_view(replace(v, stamp_ns=10**9 * seq), seen, bytes([seq % 256]) * 16)

    def take(self, *seqs: int) -> None:
        for seq in seqs:
            self.log.integrate([self.view(seq)])

    def close(self) -> None:
        self.log.close()
