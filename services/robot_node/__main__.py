"""``python -m services.robot_node``: one simulated robot."""

from __future__ import annotations

import sys

from services.robot_node.bodies.simulated import SimulatedJudge, simulated_body
from services.robot_node.config import RobotSettings
from services.robot_node.service import RobotService
from simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.bus import Node
from surveilnav.bus.main import run_service


def main() -> None:
    """One simulated robot, until SIGTERM."""
    settings = RobotSettings()
    building = SimulatedBuilding(SimulationSettings())
    body = simulated_body(building, settings)
    _ = building.renderer  # loaded before anybody waits for a picture
    with Node("robot", settings.id) as node:
        node.run(RobotService(node, body, settings, SimulatedJudge(building)).step)


if __name__ == "__main__":
    sys.exit(run_service(main))
