"""``python -m services.robot_node``: one simulated robot."""

from __future__ import annotations

import sys

from services.robot_node.config import RobotSettings
from services.robot_node.service import RobotService, start_state
from simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.bus import Node
from surveilnav.bus.main import run_service


def main() -> None:
    settings = RobotSettings()
    building = SimulatedBuilding(SimulationSettings())
    state = start_state(building, settings)
    _ = building.renderer  # loaded before anybody waits for a picture
    with Node("robot", settings.id) as node:
        node.run(RobotService(node, building, state, settings).step)


if __name__ == "__main__":
    sys.exit(run_service(main))
