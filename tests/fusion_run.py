"""Fusion's maps on a file, without a bus: what a test needs to log, restart and compare them."""

from __future__ import annotations

import threading

import msgspec
import structlog

from surveilnav.geometry import Pose
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.sensing.packing import decode_frame, encode_rgbd
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.views import DetectedObject
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
        payload, image, depth = encode_rgbd(v.rgb, v.depth_m, depth_range_m=RANGE_M)
        header = FrameHeader(
            stamp_ns=10**9 * seq,
            source=source,
            view=0,
            seq=seq,
            floor="0",
            camera=v.camera,
            depth_range_m=RANGE_M,
            T_world_camera=Pose.from_matrix(v.T_world_camera),
            mounting_offset_m=v.mounting_offset_m,
            image=image,
            depth=depth,
        )
        chair = DetectedObject("couch", 0.6, (20.0, 40.0, 120.0, 110.0), None, self.tools.unit(seq % 3))
        detections, embedding = perception_to_wire(self.tools.seen(chair, image=self.tools.unit(seq % 4)))
        reply = InferReply(
            stamp_ns=1,
            worker="w",
            backend="b",
            source=source,
            view=0,
            seq=seq,
            detections=detections,
            image_embedding=embedding,
        )
        return PerceivedView(
            (source, 0),
            header,
            decode_frame(header, payload),
            perception_from_wire(reply, v.camera),
            payload,
            msgspec.msgpack.encode(reply),
            bytes([seq % 256]) * 16,
        )

    def take(self, *seqs: int) -> None:
        for seq in seqs:
            self.log.integrate([self.view(seq)])

    def close(self) -> None:
        self.log.close()
