"""Pure planning: ``step(state, maps, robot, config)`` gives a mission's next action. It uses no bus and no clock.

step        perceive, choose, drive; inputs: the maps and the robot at one step; decision: what the step answers
context     all that is known at a step; reach: where the robot can get to, worked out once a step
choice      the decision: what is proposed, and by which rule one option is chosen (choice_rules, sequence)
options/    what the robot could do next, a file for each kind; nothing here changes anything
goals/      what is known of objects, frontiers, floors and stairs (questions only)
places/     a learned model of what lies beyond frontiers
memory/     what a mission remembers, and every method that changes it
motion/     how it gets there: terrain, Fast Marching, the local planner
behaviours/ what it does about the chosen option: explore, approach an object, take stairs
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
