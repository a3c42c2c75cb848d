"""Dimensions and abilities of the robot: Habitat's ObjectNav robot (habitat-lab ``objectnav_hm3d``).

The robot node, the planner, the maps and the simulator's judge must agree on these numbers, so they are defined here only.
A robot of another size changes them here.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole

#: The footprint is a disc of this radius.
RADIUS_M = 0.18
#: The robot needs this much room above the floor. It drives over what is lower than ``CLIMB_M`` (Recast's "max climb"):
#: carpets, door sills.
HEIGHT_M = 1.0
CLIMB_M = 0.1
#: Height of the camera above the floor.
CAMERA_HEIGHT_M = 0.88
#: Intrinsics of the camera, 640 x 480 pixels at 79 degrees, and how far it tilts up and down.
HFOV_RAD = math.radians(79.0)
CAMERA = Pinhole.from_hfov(640, 480, HFOV_RAD)
MAX_PITCH_RAD = math.radians(60.0)
#: (nearest, farthest) depth that the camera measures.
DEPTH_RANGE_M = (0.5, 5.0)
#: ``move_forward`` goes this far; ``turn_left`` and ``turn_right``, ``look_up`` and ``look_down`` turn by these angles.
STEP_M = 0.25
TURN_RAD = math.radians(30.0)
LOOK_RAD = math.radians(30.0)
#: To take a stair the robot must be this near to its end, measured on the floor.
STAIR_REACH_M = 0.5


def clearance_m(blocked: NDArray[np.bool_], resolution_m: float) -> NDArray[np.float32]:
    """(rows, cols) distance from each cell's centre to the centre of the nearest blocked cell [m].

    The distance transform is exact. Cells beyond the grid's edge count as free.

    Args:
        blocked: (rows, cols), cells that an obstacle reaches into.
    """
    free = np.ascontiguousarray(~np.asarray(blocked, dtype=np.bool_)).view(np.uint8)
    distance_px = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # OpenCV's last bit depends on where the array lies in memory. Squared distances between cells are integers.
    exact_px: NDArray[np.float32] = np.sqrt(np.rint(distance_px * distance_px))
    return exact_px * np.float32(resolution_m)


def fits(clearance: NDArray[np.float32], radius_m: float = RADIUS_M, spare_m: float = 0.0) -> NDArray[np.bool_]:
    """Where the robot's centre may be, by ``clearance_m``. Planner and judge both use this rule.

    With the default radius, a corridor along the grid must have seven open cells of 5 cm.

    Args:
        spare_m: how much thicker obstacles may appear in the map than they are. A map made from views spills over by a cell.
    """
    return np.asarray(clearance + np.float32(spare_m) > radius_m)
