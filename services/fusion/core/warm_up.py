"""Inner loops are compiled before anybody waits for them: by views of a made-up room, in maps that are thrown away.

Numba compiles a loop when it is called for the first time: fifteen seconds for all of them after an installation, one second
in every process after that, when they are read from its cache. A robot would wait for that.
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

_CAMERA = Pinhole.from_hfov(640, 480, math.radians(79.0))  # coarser, a thing has too few points for a cluster
_RANGE_M = (0.2, 8.0)
_EXTENT = {"extent_m": 24.0, "max_extent_m": 150.0}  # the room fits, whatever is set
_ROOM_M = np.array([[-3.0, -3.0, 0.0], [3.0, 3.0, 2.6]])  # its corners
_FLOOR = "0"
_DOWN_RAD = 0.3  # so much all cameras look down
_UP_M = 0.88  # a robot's camera above its floor
_EMBEDDING = np.eye(1, 8, dtype=np.float32)[0]
_CHAIR = DetectedObject("chair", 0.9, (280.0, 200.0, 360.0, 280.0), None, _EMBEDDING)
_PERCEPTION = ViewPerception("warm-up", (_CHAIR,), _EMBEDDING, "warm-up")


def warm_up(config: FusionConfig) -> None:
    """Has every loop compiled that a search calls, or read from Numba's cache."""
    joint = JointMap(config.changed({"map": _EXTENT}))
    for seq, yaw_rad in enumerate((0.0, 0.2, 3.0)):
        joint.accept(_view("robot/warm-up", seq, (0.0, 0.0, _UP_M), yaw_rad), _PERCEPTION)
    hung = _view("camera/warm-up", 0, (-2.5, -2.5, 2.4), 0.8)
    footprint = ViewFootprint.from_view(
        hung.T_world_camera, hung.camera, hung.floor_z_m, config.map.explored_range_camera_m
    )
    joint.view_utilities([footprint, footprint], [(0.0, 0.0, 0.0)])
    joint.accept(hung, _PERCEPTION)
    for layer in ("occupancy", "explored", "frontier", "cloud", "provenance"):
        joint.layer(_FLOOR, layer)
    joint.layer(_FLOOR, "value", _EMBEDDING, "warm-up")
    joint.objects(_FLOOR)


def _view(source: str, seq: int, p_world: tuple[float, float, float], yaw_rad: float) -> PosedView:
    """What a camera sees of the empty room, looking along ``yaw_rad`` and down a little."""
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
    """(height, width) [m] along the optical axis, to the nearest of floor, ceiling and walls."""
    along = _CAMERA.rays() @ T_world_camera[:3, :3].T  # a step along each is 1 m along the optical axis
    with np.errstate(divide="ignore"):
        depths: NDArray[np.float64] = (np.where(along > 0.0, _ROOM_M[1], _ROOM_M[0]) - T_world_camera[:3, 3]) / along
    return np.asarray(depths.min(axis=-1), np.float32)
