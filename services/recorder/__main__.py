"""``python -m surveilnav.services.recorder``: every mission as one MCAP file."""

from __future__ import annotations

import sys

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service
from surveilnav.pictures import PictureSettings
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.service import RecorderService


def main() -> None:
    """Records until SIGTERM."""
    settings = RecorderSettings()
    with Node("recorder", settings.id, BusSettings()) as node:
        service = RecorderService(node, settings, PictureSettings().keep_s)
        try:
            node.run(service.step, idle_s=0.1)
        finally:
            service.close()


if __name__ == "__main__":
    sys.exit(run_service(main))
