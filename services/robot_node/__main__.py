"""``python -m surveilnav.services.robot_node``: one simulated robot."""

from __future__ import annotations

import sys

from surveilnav.bus import Node
from surveilnav.bus.main import run_service
from surveilnav.services.robot_node.bodies.simulated import SimulatedJudge, open_simulated_body
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.service import RobotService
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


def main() -> None:
    """Runs one simulated robot until SIGTERM."""
    settings = RobotSettings()
    building = SimulatedBuilding(SimulationSettings())
    body = open_simulated_body(building, settings)
    _ = building.renderer  # loads it now: the first observation then doesn't wait for it
    with Node("robot", settings.id) as node:
        node.run(RobotService(node, body, settings, SimulatedJudge(building)).step)


if __name__ == "__main__":
    sys.exit(run_service(main))
