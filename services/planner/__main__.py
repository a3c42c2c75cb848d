"""``python -m surveilnav.services.planner``: missions for the robots of a building."""

from __future__ import annotations

import sys

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service, run_warm_up
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.core.warm_up import warm_up
from surveilnav.services.planner.service import PlannerService


def main() -> None:
    settings = PlannerSettings()
    run_warm_up(lambda: warm_up(settings.core))  # the planner is there when it can work
    with Node("planner", "planner", BusSettings()) as node:
        node.run(PlannerService(node, settings).step, idle_s=0.2)


if __name__ == "__main__":
    sys.exit(run_service(main))
