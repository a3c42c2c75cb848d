"""``python -m surveilnav.services.robot_node``: one robot, of a robot file or of a simulated building."""

from __future__ import annotations

import sys

from surveilnav.bus.main import run_service
from surveilnav.services.robot_node.config import RobotSettings


def main() -> None:
    """Runs one robot until SIGTERM."""
    settings = RobotSettings()
    if settings.file:
        from surveilnav.services.robot_node.real import run_real_robot

        run_real_robot(settings)
    else:  # a real robot needs none of the simulator's packages
        from surveilnav.services.robot_node.simulated import run_simulated_robot

        run_simulated_robot(settings)


if __name__ == "__main__":
    sys.exit(run_service(main))
