"""The robot that searches: Habitat's ObjectNav robot (habitat-lab ``objectnav_hm3d``), said once for everybody.

Motion, planning, maps and the simulator's judge must agree on it. A robot of another size changes these lines.
"""

from __future__ import annotations

import math

#: Its footprint is a disc of this radius.
RADIUS_M = 0.18
#: Its camera's height above the floor.
CAMERA_HEIGHT_M = 0.88
#: How far ``move_forward`` goes, and ``turn_left``, ``turn_right``, ``look_up`` and ``look_down`` turn.
STEP_M = 0.25
TURN_RAD = math.radians(30.0)
LOOK_RAD = math.radians(30.0)
#: How near (on the floor) to the end of a stair it must be to take it.
STAIR_REACH_M = 0.5
