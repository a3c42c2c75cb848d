"""ROS 2's messages of what a simulated robot knows, measures and sees."""

from __future__ import annotations

import math
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid, Pinhole
from surveilnav.robot_frame import PlanarTransform
from surveilnav.ros2 import types

Quaternion = tuple[float, float, float, float]

#: (x, y, z, w) of an optical frame (z forward, y down) in a camera's frame (x forward, z up): REP-103.
OPTICAL: Quaternion = (-0.5, 0.5, -0.5, 0.5)
#: Header of image_transport's compressedDepth: its format (0), and two numbers that quantise depth in metres.
_COMPRESSED_DEPTH = struct.Struct("<iff")
_DEPTH_QUANTISATION, _DEPTH_MAX_M = 100.0, 10.0
_UNKNOWN = 0


def stamp(stamp_ns: int) -> Any:
    return types.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def header(stamp_ns: int, frame: str) -> Any:
    return types.make("std_msgs/msg/Header", stamp=stamp(stamp_ns), frame_id=frame)


def clock(stamp_ns: int) -> Any:
    return types.make("rosgraph_msgs/msg/Clock", clock=stamp(stamp_ns))


def about_vertical(yaw_rad: float) -> Quaternion:
    return 0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)


def tilted(pitch_rad: float) -> Quaternion:
    """A camera tilted upwards by ``pitch_rad``: a turn about y, which points to the left."""
    return 0.0, math.sin(-pitch_rad / 2), 0.0, math.cos(-pitch_rad / 2)


def transform(stamp_ns: int, parent: str, child: str, p_m: tuple[float, float, float], q: Quaternion) -> Any:
    """geometry_msgs/TransformStamped."""
    return types.make(
        "geometry_msgs/msg/TransformStamped",
        header=header(stamp_ns, parent),
        child_frame_id=child,
        transform=types.make("geometry_msgs/msg/Transform", translation=_vector(*p_m), rotation=_quaternion(q)),
    )


def planar_transform(stamp_ns: int, parent: str, child: str, T: PlanarTransform) -> Any:
    return transform(stamp_ns, parent, child, (T.x_m, T.y_m, 0.0), about_vertical(T.yaw_rad))


def tf(*transforms: Any) -> Any:
    return types.make("tf2_msgs/msg/TFMessage", transforms=list(transforms))


def odometry(
    stamp_ns: int, frame: str, child: str, T: PlanarTransform, speed_m_s: float, turn_rate_rad_s: float
) -> Any:
    """nav_msgs/Odometry. Velocities are in the child's frame."""
    pose = types.make("geometry_msgs/msg/PoseWithCovariance", pose=_pose(T), covariance=np.zeros(36))
    twist = types.make(
        "geometry_msgs/msg/Twist", linear=_vector(speed_m_s, 0.0, 0.0), angular=_vector(0.0, 0.0, turn_rate_rad_s)
    )
    return types.make(
        "nav_msgs/msg/Odometry",
        header=header(stamp_ns, frame),
        child_frame_id=child,
        pose=pose,
        twist=types.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def camera_info(stamp_ns: int, frame: str, camera: Pinhole) -> Any:
    """sensor_msgs/CameraInfo of a camera without distortion."""
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    roi = types.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return types.make(
        "sensor_msgs/msg/CameraInfo",
        header=header(stamp_ns, frame),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def image(stamp_ns: int, frame: str, pixels: NDArray[Any], encoding: str) -> Any:
    """sensor_msgs/Image of an array (height, width[, channels])."""
    pixels = np.ascontiguousarray(pixels)
    return types.make(
        "sensor_msgs/msg/Image",
        header=header(stamp_ns, frame),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
        data=pixels.reshape(-1).view(np.uint8),
    )


def jpeg(stamp_ns: int, frame: str, rgb: NDArray[np.uint8]) -> Any:
    """sensor_msgs/CompressedImage of a colour picture."""
    data = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    return _compressed(stamp_ns, frame, "rgb8; jpeg compressed bgr8", data.reshape(-1))


def compressed_depth(stamp_ns: int, frame: str, depth: NDArray[Any], encoding: str) -> Any:
    """sensor_msgs/CompressedImage of depth, as image_transport's plugin compressedDepth makes it: millimetres as they are, metres
    as 16 bits of their inverse.

    Source: https://github.com/ros-perception/image_transport_plugins, compressed_depth_image_transport.
    """
    a = b = 0.0
    if encoding == "32FC1":
        a = _DEPTH_QUANTISATION * (_DEPTH_QUANTISATION + 1.0)
        b = 1.0 - a / _DEPTH_MAX_M
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where((depth > 0) & (depth < _DEPTH_MAX_M), a / depth + b, 0.0)
        depth = np.clip(np.nan_to_num(inverse), 0, 65535).astype(np.uint16)
    png = cv2.imencode(".png", depth)[1].reshape(-1)
    data = np.concatenate([np.frombuffer(_COMPRESSED_DEPTH.pack(0, a, b), np.uint8), png])
    return _compressed(stamp_ns, frame, f"{encoding}; compressedDepth png", data)


def laser_scan(
    stamp_ns: int, frame: str, ranges_m: NDArray[np.float32], range_m: tuple[float, float], period_s: float
) -> Any:
    """sensor_msgs/LaserScan of ranges all around, anticlockwise from straight behind; inf where nothing is near enough."""
    step = 2 * math.pi / len(ranges_m)
    return types.make(
        "sensor_msgs/msg/LaserScan",
        header=header(stamp_ns, frame),
        angle_min=-math.pi,
        angle_max=math.pi - step,
        angle_increment=step,
        time_increment=0.0,
        scan_time=period_s,
        range_min=range_m[0],
        range_max=range_m[1],
        ranges=ranges_m,
        intensities=np.zeros(0, np.float32),
    )


def battery(stamp_ns: int, percentage: float) -> Any:
    """sensor_msgs/BatteryState; ``percentage`` from 0 to 1."""
    nothing = np.zeros(0, np.float32)
    return types.make(
        "sensor_msgs/msg/BatteryState",
        header=header(stamp_ns, "base_link"),
        voltage=24.0 + 4.0 * percentage,
        temperature=math.nan,
        current=math.nan,
        charge=math.nan,
        capacity=math.nan,
        design_capacity=math.nan,
        percentage=percentage,
        power_supply_status=_UNKNOWN,
        power_supply_health=_UNKNOWN,
        power_supply_technology=_UNKNOWN,
        present=True,
        cell_voltage=nothing,
        cell_temperature=nothing,
        location="",
        serial_number="",
    )


def occupancy_grid(stamp_ns: int, cells: NDArray[np.int8], grid: Grid, T_map_grid: PlanarTransform) -> Any:
    """nav_msgs/OccupancyGrid of cells (rows, cols): 0 free, 100 occupied, -1 unknown. Rows go up, as in a ``Grid``.

    ``T_map_grid``: the grid's frame in the map; the origin of its cells is ``grid``'s corner there.
    """
    origin = T_map_grid @ PlanarTransform(grid.origin_x_m, grid.origin_y_m)
    info = types.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=stamp(stamp_ns),
        resolution=grid.resolution_m,
        width=grid.cols,
        height=grid.rows,
        origin=_pose(origin),
    )
    data = np.ascontiguousarray(cells, np.int8).ravel()
    return types.make("nav_msgs/msg/OccupancyGrid", header=header(stamp_ns, "map"), info=info, data=data)


def _compressed(stamp_ns: int, frame: str, format: str, data: NDArray[np.uint8]) -> Any:
    return types.make("sensor_msgs/msg/CompressedImage", header=header(stamp_ns, frame), format=format, data=data)


def _vector(x: float, y: float, z: float) -> Any:
    return types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _quaternion(q: Quaternion) -> Any:
    return types.make("geometry_msgs/msg/Quaternion", x=q[0], y=q[1], z=q[2], w=q[3])


def _pose(T: PlanarTransform) -> Any:
    point = types.make("geometry_msgs/msg/Point", x=T.x_m, y=T.y_m, z=0.0)
    return types.make("geometry_msgs/msg/Pose", position=point, orientation=_quaternion(about_vertical(T.yaw_rad)))
