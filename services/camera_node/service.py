"""The camera node: renders, encodes and puts a view only while somebody listens to it."""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import Any

import cv2

from services.camera_node import core
from services.camera_node.config import CameraSettings
from simulator.simulation import CAMERA_DEPTH_RANGE_M, SimulatedBuilding
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.camera_plan import PlannedCamera
from surveilnav.contract import CAMERA_FRAME, CAMERA_INFO, CAMERA_REQUEST, TRUTH
from surveilnav.messages import Ack, CameraInfo, CameraViewInfo, FrameHeader, Truth
from surveilnav.sensing.packing import encode_jpeg, encode_rgbd, pack_array


class CameraService:
    """Serves the views of one camera of the plan."""

    def __init__(
        self, node: Node, building: SimulatedBuilding, camera: PlannedCamera, settings: CameraSettings
    ) -> None:
        self._node, self._building, self._camera, self._settings = node, building, camera, settings
        self._place: dict[str, Any] = {"floor": camera.floor, "camera": camera.name}
        views = range(len(camera.views))
        self._frames = {v: node.publisher(CAMERA_FRAME, **self._place, view=v) for v in views}
        self._truths = {v: node.publisher(TRUTH, source=f"camera-{camera.name}", view=v) for v in views}
        self._state = core.SendState()
        self._requested: set[int] = set()
        self._lock = threading.Lock()
        #: Frames are on their way: whatever can wait should.
        self.sending = False
        self._seq = dict.fromkeys(views, 0)
        self._truth_labels = building.scene.truth_labels
        self._encoded = lru_cache(maxsize=len(camera.views))(self._encode)
        node.serve(CAMERA_INFO, lambda _: Answer(self._info()), **self._place)
        node.serve(CAMERA_REQUEST, self._on_request, **self._place)
        node.publisher(CAMERA_INFO, **self._place).put(self._info())

    def step(self) -> bool:
        """Puts the views that are due; True if there were any."""
        matched = {v for v, publisher in self._frames.items() if publisher.matched}
        with self._lock:
            requested, self._requested = self._requested, set()
        # A rendered building doesn't change: every view stays at version 0.
        self._state, due = core.views_to_send(
            self._state, versions=dict.fromkeys(self._frames, 0), matched=matched, requested=requested
        )
        self.sending = bool(due)
        for view in due:
            if self._node.stopping.is_set():
                break
            self._put(view)
        self.sending = False
        return bool(due)

    def _put(self, view: int) -> None:
        payload, image, depth = self._encoded(view)
        self._seq[view] += 1
        self._put_truth(view)
        header = FrameHeader(
            stamp_ns=clock_ns(), source=f"camera/{self._camera.name}", view=view, seq=self._seq[view],
            floor=self._camera.floor, T_world_camera=self._camera.views[view], camera=self._building.plan.intrinsics,
            mounting_offset_m=self._building.plan.mounting_offset_m, depth_range_m=CAMERA_DEPTH_RANGE_M,
            image=image, depth=depth,
        )  # fmt: skip
        self._frames[view].put(header, payload)

    def _encode(self, view: int):  # type: ignore[no-untyped-def]
        rendered = self._building.camera_view(self._camera, view)
        return encode_rgbd(
            rendered.rgb, rendered.depth_m, depth_range_m=CAMERA_DEPTH_RANGE_M, jpeg_quality=self._settings.jpeg_quality
        )

    def _put_truth(self, view: int) -> None:
        if not self._truths[view].matched:  # only the backends oracle and simulated ever listen
            return
        ids = self._building.camera_view(self._camera, view).instance_ids
        truth = Truth(
            stamp_ns=clock_ns(), source=f"camera/{self._camera.name}", view=view, seq=self._seq[view],
            width_px=ids.shape[1], height_px=ids.shape[0], labels=self._truth_labels,
            T_world_camera=self._camera.views[view],
        )  # fmt: skip
        self._truths[view].put(truth, pack_array(ids))

    def _info(self) -> CameraInfo:
        return CameraInfo(
            stamp_ns=clock_ns(), camera=self._camera.name, floor=self._camera.floor, position_m=self._camera.position_m,
            mounting_offset_m=self._building.plan.mounting_offset_m, intrinsics=self._building.plan.intrinsics,
            views=[CameraViewInfo(v, pose) for v, pose in enumerate(self._camera.views)],
        )  # fmt: skip

    def _on_request(self, request: Request) -> Answer:
        unknown = set(request.message.views) - set(self._frames)
        if unknown or not request.message.views:
            raise Refused("bad_view", f"expected views of 0-{len(self._frames) - 1}, got {request.message.views}")
        if request.message.action == "thumbnail":
            return Answer(Ack(stamp_ns=clock_ns()), self._thumbnail(request.message.views[0]))
        with self._lock:
            self._requested |= set(request.message.views)
        self._node.wake.set()
        return Answer(Ack(stamp_ns=clock_ns(), message=f"{len(request.message.views)} views will come again"))

    def _thumbnail(self, view: int) -> bytes:
        rgb = self._building.camera_view(self._camera, view).rgb
        width = self._settings.thumbnail_width_px
        height = round(width * rgb.shape[0] / rgb.shape[1])
        return encode_jpeg(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA), 80)
