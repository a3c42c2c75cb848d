"""Where the robot is in the building, and whether that can be trusted."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np

from surveilnav.geometry import Matrix4, Pose
from surveilnav.robot_file import RobotFile
from surveilnav.robot_frame import PlanarTransform
from surveilnav.services.robot_node.bodies.ros2.camera import stamp_of
from surveilnav.services.robot_node.bodies.ros2.transforms import TransformBuffer, TransformError

#: Odometry that moves by more than this, and by more than at this speed since the last message, wasn't driven.
_JUMP_M, _FASTEST_M_S = 0.5, 3.0
#: The place in the map that changes by more than odometry says was corrected by the localisation, which people should know.
_CORRECTED_M = 0.3
#: One that changed by more means that it may have another map, or was lost until now: then nothing is believed any more.
_MOVED_M = 1.0
#: A localisation that is less sure than this (standard deviation along the worse axis) is lost.
_LOST_M = 0.5
#: No odometry, or no transform, for so long means that the robot's place isn't known.
_SILENT_S = 3.0
#: The localisation's transform changes slowly and comes seldom, so it holds for a while.
_MAP_HOLD_NS = 2 * 10**9


class RobotPlace:
    """The robot's place in its map by its transforms, and in the building by ``T_building_map``. Thread-safe.

    Attributes:
        path_m: length of the way driven, by odometry.
        speed_m_s, turn_rad_s: by the newest odometry; ``odometry_s``: when it came.
        notes: what people should know of it.
    """

    def __init__(self, file: RobotFile, transforms: TransformBuffer) -> None:
        self._file, self._transforms = file, transforms
        self._lock = threading.Lock()
        self._T_building_map = file.T_building_map.transform() if file.T_building_map else None
        self._began_s = time.monotonic()
        self._odom: tuple[int, float, float, bytes] | None = None  # stamp, x, y, sender
        self._restarted_ns: int | None = None
        self._frame_lost = ""
        self._moved = ""
        self._deviation_m = 0.0
        self._last_map: tuple[PlanarTransform, PlanarTransform] | None = None  # T_map_base and T_odom_base
        self.path_m = self.speed_m_s = self.turn_rad_s = 0.0
        self.odometry_s = -math.inf
        self.notes: list[str] = []

    # --- what the robot tells -------------------------------------------------------------------------------------

    def add_transforms(self, message: Any, *, static: bool) -> None:
        """A tf2_msgs/TFMessage. Transforms that can't be are left out."""
        for stamped in message.transforms:
            t, q = stamped.transform.translation, stamped.transform.rotation
            try:
                pose = Pose((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))
            except ValueError:
                continue
            self._transforms.add(
                stamped.header.frame_id, stamped.child_frame_id, stamp_of(stamped.header), pose, static=static
            )

    def add_odometry(self, message: Any, sender: bytes) -> None:
        """A nav_msgs/Odometry. ``sender`` identifies the process, so that its restart is noticed."""
        p, twist = message.pose.pose.position, message.twist.twist
        stamp_ns = stamp_of(message.header)
        if not all(map(math.isfinite, (p.x, p.y, twist.linear.x, twist.linear.y, twist.angular.z))):
            return
        with self._lock:
            last, self._odom = self._odom, (stamp_ns, p.x, p.y, sender)
            self.odometry_s = time.monotonic()
            self.speed_m_s, self.turn_rad_s = math.hypot(twist.linear.x, twist.linear.y), abs(twist.angular.z)
            if last is None:
                return
            moved_m = math.hypot(p.x - last[1], p.y - last[2])
            driven_m = _FASTEST_M_S * max(0, stamp_ns - last[0]) / 1e9
            if sender != last[3] or moved_m > _JUMP_M + driven_m or stamp_ns < last[0] - 10**9:
                self._on_restart(stamp_ns, moved_m)
            else:
                self.path_m += moved_m

    def add_localisation(self, message: Any) -> None:
        """A PoseWithCovarianceStamped: how sure the robot is of its place."""
        covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)[:2, :2]
        if np.isfinite(covariance).all():
            self._deviation_m = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance)[-1])))

    def set_frame(self, T_building_map: PlanarTransform | None) -> None:
        """The map's place in the building was measured anew: what was lost is known again."""
        with self._lock:
            self._T_building_map, self._frame_lost, self._restarted_ns = T_building_map, "", None
            self._moved, self._last_map = "", None

    def _on_restart(self, stamp_ns: int, moved_m: float) -> None:
        """Odometry has begun anew. A robot without a localisation of its own then has another map than before."""
        frames = self._file.frames
        self._restarted_ns = stamp_ns
        self._last_map = None
        if frames.map == frames.odom:
            self._frame_lost = (
                f"its odometry began anew ({moved_m:.2f} m from where it was), so where its map lies in the building isn't known "
                "any more: measure it again (surveilnav robots frame)"
            )

    # --- where it is ----------------------------------------------------------------------------------------------

    def problem(self) -> str:
        """Why the robot's place isn't known, for people; empty if it is."""
        with self._lock:
            if self._T_building_map is None:
                return "where its map lies in the building isn't known: measure it (surveilnav robots frame)"
            if self._frame_lost:
                return self._frame_lost
            if self._moved:
                return self._moved
            silent_s = time.monotonic() - max(self.odometry_s, self._began_s)
        if silent_s > _SILENT_S:
            since = "yet" if self.odometry_s == -math.inf else f"for {silent_s:.0f} s"
            return f"no odometry came {since} on {self._file.topics.odometry!r}"
        if self._deviation_m > _LOST_M:
            return f"its localisation is lost: it knows its place to {self._deviation_m:.1f} m only"
        try:
            self.base_in_building()
        except TransformError as error:
            return str(error)
        return ""

    def base_in_building(self, stamp_ns: int | None = None) -> PlanarTransform:
        """Where its base is in the building at a moment of its clock; None: now. Raises TransformError."""
        T_map_base = PlanarTransform.from_matrix(self._in_map(self._file.frames.base, stamp_ns))
        return self._frame() @ T_map_base

    def camera_in_building(self, camera_frame: str, stamp_ns: int) -> Matrix4:
        """``T_world_camera`` (4, 4) of its camera at a moment. Raises TransformError."""
        T: Matrix4 = self._frame().matrix(self._file.floor_z_m) @ self._in_map(camera_frame, stamp_ns)
        return T

    def camera_on_base(self, camera_frame: str) -> Matrix4:
        """Where its camera is on its base. Raises TransformError."""
        return self._transforms.lookup(self._file.frames.base, camera_frame)

    def to_map(self, x_m: float, y_m: float, yaw_rad: float) -> PlanarTransform:
        """A pose in the building, in the robot's map. Raises TransformError: the map's place isn't known."""
        return self._frame().inverse() @ PlanarTransform(x_m, y_m, yaw_rad)

    def _frame(self) -> PlanarTransform:
        with self._lock:
            if self._T_building_map is None or self._frame_lost:
                raise TransformError("where its map lies in the building isn't known")
            return self._T_building_map

    def _in_map(self, frame: str, stamp_ns: int | None) -> Matrix4:
        """``T_map_frame`` at a moment: interpolated from odometry, and by the localisation's last correction."""
        frames, transforms = self._file.frames, self._transforms
        T_odom = transforms.lookup(frames.odom, frame, stamp_ns)
        if frames.map == frames.odom:
            return T_odom
        corrected_ns, restarted_ns = transforms.newest_ns(frames.odom), self._restarted_ns
        if restarted_ns is not None and (corrected_ns is None or corrected_ns <= restarted_ns):
            raise TransformError("its odometry began anew, and its localisation hasn't placed it since")
        T: Matrix4 = transforms.lookup(frames.map, frames.odom, stamp_ns, _MAP_HOLD_NS) @ T_odom
        return T

    def record_corrections(self) -> None:
        """Notes a place in the map that changed by more than the robot drove since the last call."""
        frames = self._file.frames
        try:
            T_odom_base = PlanarTransform.from_matrix(self._transforms.lookup(frames.odom, frames.base))
            T_map_base = PlanarTransform.from_matrix(self._in_map(frames.base, None))
        except TransformError:
            return
        last, self._last_map = self._last_map, (T_map_base, T_odom_base)
        if last is None:
            return
        expected = last[0] @ (last[1].inverse() @ T_odom_base)
        off_m, off_rad = expected.difference(T_map_base)
        if off_m <= _CORRECTED_M:
            return
        said = f"its localisation moved it by {off_m:.2f} m and {math.degrees(off_rad):.0f} degrees at once"
        self.notes = [said]
        if off_m > _MOVED_M:
            self._moved = (
                f"{said}: it was lost, or has another map. If it is now where the page shows it, save its robot file again as it "
                "is; else measure where its map lies (surveilnav robots frame)"
            )
