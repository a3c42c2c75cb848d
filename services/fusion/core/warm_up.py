"""Compiles the inner loops before anybody waits for them, by integrating views of an artificial room into throw-away maps.

Numba compiles a function when it is first called. For all of them, that takes fifteen seconds after an installation, and one
second in every later process, which reads them from Numba's cache. A robot would have to wait for that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception
from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.joint_map import JointMap
from surveilnav.services.fusion.core.views.order import ViewFootprint
from surveilnav.services.fusion.core.views.pose_fit import fit_pose

_CAMERA = Pinhole.from_hfov(
    640, 480, math.radians(79.0)
)  # with fewer pixels, an object has too few points for a cluster
_RANGE_M = (0.2, 8.0)
_EXTENT = {"extent_m": 24.0, "max_extent_m": 150.0}  # so that the room fits, whatever the settings are
_ROOM_M = np.array([[-3.0, -3.0, 0.0], [3.0, 3.0, 2.6]])  # two opposite corners
_FLOOR = "0"
_DOWN_RAD = 0.3  # by which all cameras look down
_ROBOT_CAMERA_M = 0.88  # height above the floor
_EMBEDDING = np.eye(1, 8, dtype=np.float32)[0]
_N_COMPARED = 500  # points of which a pose is compared
_CHAIR = DetectedObject("chair", 0.9, (280.0, 200.0, 360.0, 280.0), None, _EMBEDDING)
_PERCEPTION = ViewPerception("warm-up", (_CHAIR,), _EMBEDDING, "warm-up")


def warm_up(config: FusionConfig) -> None:
    """Compiles every inner loop that a search calls, or reads it from Numba's cache."""
    joint = JointMap(config.changed({"map": _EXTENT}))
    for seq, yaw_rad in enumerate((0.0, 0.2, 3.0)):
        joint.accept(_view("robot/warm-up", seq, (0.0, 0.0, _ROBOT_CAMERA_M), yaw_rad), _PERCEPTION)
    mounted = _view("camera/warm-up", 0, (-2.5, -2.5, 2.4), 0.8)
    footprint = ViewFootprint.from_view(
        mounted.T_world_camera, mounted.camera, mounted.floor_z_m, config.map.explored_range_camera_m
    )
    joint.view_utilities([footprint, footprint], [(0.0, 0.0, 0.0)])
    joint.accept(mounted, _PERCEPTION)
    for layer in ("occupancy", "explored", "frontier", "cloud", "provenance"):
        joint.layer(_FLOOR, layer)
    joint.layer(_FLOOR, "value", _EMBEDDING, "warm-up")
    joint.objects(_FLOOR)
    points = np.random.default_rng(0).uniform(_ROOM_M[0], _ROOM_M[1], (_N_COMPARED, 3))
    fit_pose(points, points, np.zeros(2), 0.0)


def _view(source: str, seq: int, p_world: tuple[float, float, float], yaw_rad: float) -> PosedView:
    """What a camera sees of the empty room when it looks along ``yaw_rad`` and a little down."""
    T_world_camera = camera_pose(p_world, yaw_rad, -_DOWN_RAD)
    return PosedView(
        source,
        0,
        seq,
        seq,
        _FLOOR,
        T_world_camera,
        _CAMERA,
        p_world[2],
        np.zeros((_CAMERA.height_px, _CAMERA.width_px, 3), np.uint8),
        _depth_m(T_world_camera),
        _RANGE_M,
    )


def _depth_m(T_world_camera: Matrix4) -> NDArray[np.float32]:
    """Depth (height, width) [m] along the optical axis of the nearest of floor, ceiling and walls."""
    rays = _CAMERA.rays() @ T_world_camera[:3, :3].T  # each advances 1 m along the optical axis
    with np.errstate(divide="ignore"):
        depths: NDArray[np.float64] = (np.where(rays > 0.0, _ROOM_M[1], _ROOM_M[0]) - T_world_camera[:3, 3]) / rays
    return np.asarray(depths.min(axis=-1), np.float32)
