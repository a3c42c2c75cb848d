"""The robot's RGB-D camera: renders where the robot is, on a thread of its own, while somebody subscribes."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from surveilnav.robot_state import RobotState
from surveilnav.ros2.names import qualified
from surveilnav.ros2.session import RosPublisher, RosSession
from surveilnav.simulator.hardware import ros_messages as ros
from surveilnav.simulator.hardware.config import RobotHardwareSettings
from surveilnav.simulator.hardware.faults import Faults
from surveilnav.simulator.render.picture import Rendered
from surveilnav.simulator.simulation import SimulatedBuilding

FRAME = "camera_color_optical_frame"
_IMAGE, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


class RobotCamera:
    """``latest``: the robot's state, with the stamp that belongs to it [ns]. Use it as a context manager."""

    def __init__(
        self,
        session: RosSession,
        building: SimulatedBuilding,
        settings: RobotHardwareSettings,
        faults: Faults,
        latest: Callable[[], tuple[int, RobotState]],
    ) -> None:
        self._session, self._building, self._settings, self._faults = session, building, settings, faults
        self._latest, self._camera, self._count = latest, settings.camera(), 0
        type_name = _COMPRESSED if settings.compressed else _IMAGE
        self._color_topic = "camera/color/image_raw" + ("/compressed" if settings.compressed else "")
        self._depth_topic = "camera/depth/image_raw" + ("/compressedDepth" if settings.compressed else "")
        self._color = session.publisher(self._color_topic, type_name)
        self._depth: RosPublisher | None = None
        if not faults.no_depth:
            self._depth = session.publisher(self._depth_topic, type_name)
        self._infos = [
            session.publisher(f"camera/{kind}/camera_info", "sensor_msgs/msg/CameraInfo") for kind in ("color", "depth")
        ]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> RobotCamera:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        done_ns = -(10**18)
        while not self._ended.wait(0.005):
            stamp_ns, state = self._latest()
            if stamp_ns - done_ns >= 0.99e9 / self._settings.pictures_hz and self._is_watched():
                done_ns = stamp_ns
                self._publish(stamp_ns, self._render(state))

    def _is_watched(self) -> bool:
        names = {qualified(topic, self._session.namespace) for topic in (self._color_topic, self._depth_topic)}
        return any(e.kind == "MS" and e.name in names for e in self._session.graph.entities())

    def _render(self, state: RobotState) -> Rendered:
        self._count += 1
        settings = self._settings
        T_world_camera = state.camera_pose(settings.camera_height_m)
        depth_range_m = (settings.depth_min_m, settings.depth_max_m)
        return self._building.robot_view(T_world_camera, self._camera, depth_range_m, self._count)

    def _publish(self, stamp_ns: int, view: Rendered) -> None:
        for publisher in self._infos:
            publisher.put(ros.camera_info(stamp_ns, FRAME, self._camera))
        if self._settings.compressed:
            self._color.put(ros.jpeg(stamp_ns, FRAME, view.rgb))
        else:
            self._color.put(ros.image(stamp_ns, FRAME, view.rgb, "rgb8"))
        if self._depth is None:
            return
        # REP-118: no measurement is 0 in millimetres, and NaN in metres
        encoding = self._settings.depth_encoding
        millimetres = np.rint(view.depth_m * 1000.0)
        if self._faults.depth_mm_as_metres:
            encoding, depth = "32FC1", millimetres.astype(np.float32)
        elif encoding == "16UC1":
            depth = millimetres.astype(np.uint16)
        else:
            depth = np.where(view.depth_m > 0, view.depth_m, np.nan).astype(np.float32)
        encode = ros.compressed_depth if self._settings.compressed else ros.image
        self._depth.put(encode(stamp_ns, FRAME, depth, encoding))
