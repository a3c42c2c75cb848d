"""Pure planning: ``step(state, maps, robot, config)`` gives the next action of a mission. No bus, no clock."""

from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Decision, FloorMemory, MapView, MissionState, RobotView
from services.planner.core.step import step

__all__ = ["Decision", "FloorMemory", "MapView", "MissionState", "PlannerConfig", "RobotView", "step"]
