"""Pure planning: ``step(state, maps, robot, config)`` gives a mission's next action. It uses no bus and no clock.

inputs      the maps and the robot at one step; decision: what the step answers
memory/     what a mission remembers, and every method that changes it
goals/      what the robot may head for: objects, frontiers, floors, stairs (questions only)
motion/     how it gets there: terrain, Fast Marching, the local planner
behaviours/ what it does on the way and at a waypoint: explore, approach an object, take stairs
stages/     the kinds of waypoints, and the order in which they are tried (``rounds``)
config      every number
warm_up     compiles the inner loops before a robot waits for them
"""

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.floor_memory import FloorMemory
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.step import step

__all__ = ["Decision", "FloorMemory", "FloorMaps", "MissionState", "PlannerConfig", "RobotView", "step"]
