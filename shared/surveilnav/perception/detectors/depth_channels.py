"""Depth as input channels of a network: for each cell, distance, size, height, and the orientation of the surface.

All channels are computed from inverse depth, whose noise grows least with distance. The inverse depth of a plane is linear in
the picture, so that its gradient gives the plane's normal.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole

#: Share of samples with depth; inverse depth [1/m]; log of the cell's size; height below the sensor; unit normal (x, y, z).
N_CHANNELS = 7
_NEAREST_M, _FARTHEST_M = 0.1, 30.0
#: Number of depth samples that are averaged across a cell's width.
_SAMPLES = 3


def depth_channels(depth_m: NDArray[np.float32], camera: Pinhole, width: int, height: int) -> NDArray[np.float32]:
    """(height, width, ``N_CHANNELS``) float32, with values of about -2 to 2; 0 where there is no depth.

    Args:
        depth_m: (H, W) depth of the picture [m], 0 where there is none.
        camera: intrinsics of the picture.
        width, height: size of the output grid, whose cells divide the picture evenly.
    """
    step = max(1, depth_m.shape[1] // (_SAMPLES * width))
    sampled = depth_m[::step, ::step]
    there = sampled > 0
    inverse = np.divide(1.0, sampled, out=np.zeros_like(sampled), where=there)
    share = cv2.resize(there.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    inverse = cv2.resize(inverse, (width, height), interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)
    inverse = np.clip(inverse, 1.0 / _FARTHEST_M, 1.0 / _NEAREST_M)
    known = share > 0
    lens = camera.resized(width, height)
    rays = lens.rays()
    out = np.empty((height, width, N_CHANNELS), np.float32)
    out[..., 0] = share
    out[..., 1] = np.minimum(inverse, 3.0)
    out[..., 2] = 0.7 * (3.5 - np.log(inverse * lens.fx_px))
    out[..., 3] = np.clip(0.5 * rays[..., 1] / inverse, -2.0, 2.0)
    # The inverse depth of a plane with normal n at distance d is n . ray / d. Its derivatives along the rays' x and y are
    # proportional to the normal's x and y; the remainder is its z.
    across = cv2.Sobel(inverse, cv2.CV_32F, 1, 0, ksize=5, scale=lens.fx_px / 128.0)
    along = cv2.Sobel(inverse, cv2.CV_32F, 0, 1, ksize=5, scale=lens.fy_px / 128.0)
    ahead = inverse - rays[..., 0] * across - rays[..., 1] * along
    length = np.sqrt(across * across + along * along + ahead * ahead)
    whole = cv2.erode(known.astype(np.uint8), np.ones((5, 5), np.uint8)) / np.maximum(length, 1e-6)
    for channel, component in enumerate((across, along, ahead), start=4):
        out[..., channel] = component * whole
    out *= known[..., None]
    return out
