"""``python -m surveilnav.services.fusion`` runs the fusion service, which keeps the joint maps of a building."""

from __future__ import annotations

import sys

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service, run_warm_up
from surveilnav.pictures import PictureSettings
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.warm_up import warm_up
from surveilnav.services.fusion.service import FusionService


def main() -> None:
    """Runs the service until it is told to stop."""
    settings = FusionSettings()
    config = settings.core()
    run_warm_up(lambda: warm_up(config))  # before fusion announces itself on the bus
    with Node("fusion", "fusion", BusSettings()) as node:
        service = FusionService(node, settings, PictureSettings().keep_s)
        node.run(service.step)
        service.close()


if __name__ == "__main__":
    sys.exit(run_service(main))
