"""SE(3), pinhole cameras and grids: typed mathematics without any I/O."""

from surveilnav.geometry.camera import Pinhole
from surveilnav.geometry.grid import Grid
from surveilnav.geometry.se3 import Matrix4, Pose, base_pose, camera_pose, inverse, transform_points, yaw_of

__all__ = ["Grid", "Matrix4", "Pinhole", "Pose", "base_pose", "camera_pose", "inverse", "transform_points", "yaw_of"]
