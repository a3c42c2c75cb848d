"""The reference depth of a calibrated camera: how far an empty room would be. The depth network says how much nearer things are.

A picture alone doesn't tell sizes. But where a camera hangs over the floor and how it is tilted is known, so each pixel's
floor depth is known in metres. The network's input is this geometry beside the picture, its output a ratio to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole

#: The ceiling is assumed at this height over the floor, or this far above a camera that hangs higher.
CEILING_M, _ABOVE_CAMERA_M = 2.6, 0.3
#: Nothing is farther in an empty room: near the horizon, rays meet neither floor nor ceiling for a long way.
FARTHEST_M = 10.0
#: A camera must be at least so high over its floor.
LOWEST_M = 0.3
#: Inverse floor depth; sine of the ray's elevation; reference depth (log); size of a cell there (log); camera's height.
N_CHANNELS = 5
#: The channels are meant for cameras of about this height and depths of about this size.
_USUAL_HEIGHT_M, _USUAL_DEPTH_M = 2.0, 3.0
#: Size of a cell at the usual depth, in a grid 128 cells wide that shows 90 degrees.
_USUAL_CELL_M = _USUAL_DEPTH_M / 64.0
_LARGEST_INVERSE = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The depth of an empty room along each pixel's ray.

    Attributes:
        depth_m: (H, W) float32 [m] along the optical axis, above 0 and at most ``FARTHEST_M``: where the ray meets the floor or
            the ceiling.
        floor: (H, W) bool, whether that is the floor.
        elevation: (H, W) float32, sine of the angle between ray and floor; negative: downwards.
        height_m: of the camera over the floor.
    """

    depth_m: NDArray[np.float32]
    floor: NDArray[np.bool_]
    elevation: NDArray[np.float32]
    height_m: float


def reference_depth(camera: Pinhole, T_world_camera: Matrix4, floor_z_m: float) -> Reference:
    """Where each pixel's ray meets the floor or an assumed ceiling.

    Args:
        camera: intrinsics of the picture.
        T_world_camera: (4, 4) pose of the camera [m]; the world's z points up.
        floor_z_m: height of the floor in the world [m].

    Raises:
        PerceptionError: the camera isn't above its floor.
    """
    height_m = float(T_world_camera[2, 3]) - floor_z_m
    if not (math.isfinite(height_m) and height_m >= LOWEST_M):
        raise PerceptionError(
            f"the depth network needs a camera at least {LOWEST_M} m above its floor: this one is at z = "
            f"{T_world_camera[2, 3]:.2f} m, its floor at {floor_z_m:.2f} m"
        )
    rays = camera.rays()
    # A ray has z = 1 in the camera's frame, so its length until it meets a plane is the depth there.
    rise = rays @ T_world_camera[2, :3].astype(np.float32)
    above_m = max(CEILING_M - height_m, _ABOVE_CAMERA_M)
    # 1 / depth is finite everywhere, and 0 for a ray along the horizon.
    inverse = np.where(rise < 0.0, rise / np.float32(-height_m), rise / np.float32(above_m))
    depth_m = 1.0 / np.maximum(inverse, np.float32(1.0 / FARTHEST_M))
    floor = (rise < 0.0) & (inverse >= 1.0 / FARTHEST_M)
    elevation = rise / np.linalg.norm(rays, axis=-1)
    return Reference(depth_m.astype(np.float32), floor, elevation.astype(np.float32), height_m)


def reference_channels(reference: Reference, camera: Pinhole) -> NDArray[np.float32]:
    """(H, W, ``N_CHANNELS``) float32, the network's input beside the picture; values of about -2 to 2.

    Args:
        reference: at the network's output grid of H x W cells, which has half of the picture's resolution.
        camera: intrinsics of that grid.
    """
    out = np.empty((*reference.depth_m.shape, N_CHANNELS), np.float32)
    log_depth = cv2.log(reference.depth_m)
    out[..., 0] = np.where(reference.floor, np.minimum(1.0 / reference.depth_m, _LARGEST_INVERSE), 0.0)
    out[..., 1] = reference.elevation
    out[..., 2] = log_depth - math.log(_USUAL_DEPTH_M)
    out[..., 3] = log_depth - math.log(math.sqrt(camera.fx_px * camera.fy_px) * _USUAL_CELL_M)
    out[..., 4] = reference.height_m - _USUAL_HEIGHT_M
    return out
