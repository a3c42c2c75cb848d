"""``python -m services.fusion``: the joint maps of a building."""

from __future__ import annotations

import sys

from services.fusion.config import FusionSettings
from services.fusion.core.warm_up import warm_up
from services.fusion.service import FusionService
from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service, warm
from surveilnav.pictures import PictureSettings


def main() -> None:
    """Runs the service until it is told to stop."""
    settings = FusionSettings()
    config = settings.core()
    warm(lambda: warm_up(config))  # fusion is there when it can work
    with Node("fusion", "fusion", BusSettings()) as node:
        service = FusionService(node, settings, PictureSettings().keep_s)
        node.run(service.step)
        service.close()


if __name__ == "__main__":
    sys.exit(run_service(main))
