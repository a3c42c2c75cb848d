"""The robot that searches: Habitat's ObjectNav robot (habitat-lab ``objectnav_hm3d``), said once for everybody.

Motion, planning, maps and the simulator's judge must agree on it. A robot of another size changes these lines.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

#: Its footprint is a disc of this radius.
RADIUS_M = 0.18
#: It needs this much room above the floor, and drives over what is lower than ``CLIMB_M`` (Recast's "max climb"): carpets, sills.
HEIGHT_M = 1.0
CLIMB_M = 0.1
#: Its camera's height above the floor.
CAMERA_HEIGHT_M = 0.88
#: What its depth camera measures (nearest, farthest).
DEPTH_RANGE_M = (0.5, 5.0)
#: How far ``move_forward`` goes, and ``turn_left``, ``turn_right``, ``look_up`` and ``look_down`` turn.
STEP_M = 0.25
TURN_RAD = math.radians(30.0)
LOOK_RAD = math.radians(30.0)
#: How near (on the floor) to the end of a stair it must be to take it.
STAIR_REACH_M = 0.5


def clearance_m(blocked: NDArray[np.bool_], resolution_m: float) -> NDArray[np.float32]:
    """(rows, cols) distance from each cell's middle to that of the nearest blocked cell [m]: exact, without an edge.

    ``blocked``: (rows, cols), cells that something reaches into.
    """
    free = np.ascontiguousarray(~np.asarray(blocked, dtype=np.bool_)).view(np.uint8)
    cells = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # OpenCV's last bit depends on where the array lies in memory; squared distances between cells are integers
    exact: NDArray[np.float32] = np.sqrt(np.rint(cells * cells))
    return exact * np.float32(resolution_m)


def fits(clearance: NDArray[np.float32], radius_m: float = RADIUS_M, spare_m: float = 0.0) -> NDArray[np.bool_]:
    """Where the robot's centre may be, by ``clearance_m``: one rule for the planner and for the judge.

    A corridor along the grid must have seven open cells of 5 cm. ``spare_m``: how much thicker obstacles may be in the map
    than they are; a map made of views spills over by a cell.
    """
    return np.asarray(clearance + np.float32(spare_m) > radius_m)
