"""``python -m surveilnav.services.camera_node``: one surveillance camera, of cameras.yaml or of a simulated building."""

from __future__ import annotations

import sys

from surveilnav.bus import BusSettings
from surveilnav.bus.main import run_service
from surveilnav.services.camera_node.config import CameraSettings


def main() -> None:
    """Runs one camera until SIGTERM."""
    settings, bus = CameraSettings(), BusSettings()
    if settings.file:
        from surveilnav.services.camera_node.real import run_real_camera

        run_real_camera(settings, bus)
    else:  # real cameras need none of the simulator's packages
        from surveilnav.services.camera_node.simulated import run_simulated_camera

        run_simulated_camera(settings, bus)


if __name__ == "__main__":
    sys.exit(run_service(main))
