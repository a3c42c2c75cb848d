"""Pure planning: ``step(state, maps, robot, config)`` gives the next action of a mission. No bus, no clock.

goals/    what the robot may go to: objects, frontiers, floors (questions)
motion/   how it gets there: terrain, fast marching, driving
pursuit/  what it does on the way and there; ``approach`` looks at an object, believes, and decides the stop
stages/   in which order waypoints are tried (``rounds``), one file each
memory    everything that changes what a mission remembers
config    every number
warm_up   inner loops compiled before a robot waits for them
"""

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.state import Decision, FloorMemory, MapView, MissionState, RobotView
from surveilnav.services.planner.core.step import step

__all__ = ["Decision", "FloorMemory", "MapView", "MissionState", "PlannerConfig", "RobotView", "step"]
