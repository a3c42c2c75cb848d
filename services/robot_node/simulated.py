"""Runs a robot of the simulated building."""

from __future__ import annotations

from surveilnav.bus import Node
from surveilnav.services.robot_node.bodies.simulated import SimulatedJudge, open_simulated_body
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.service import RobotService
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


def run_simulated_robot(settings: RobotSettings) -> None:
    """Runs one simulated robot until SIGTERM."""
    building = SimulatedBuilding(SimulationSettings())
    body = open_simulated_body(building, settings)
    _ = building.renderer  # loads it now: the first observation then doesn't wait for it
    with Node("robot", settings.id) as node:
        node.run(RobotService(node, body, settings, SimulatedJudge(building)).step)
