"""``python -m surveilnav.simulator.hardware.rtsp_cameras``: a simulated building's cameras as fisheye cameras that speak RTSP."""

from __future__ import annotations

import asyncio
import sys

from surveilnav.bus.main import run_service
from surveilnav.errors import SurveilNavError
from surveilnav.simulator.hardware import fisheye
from surveilnav.simulator.hardware.config import CameraHardwareSettings
from surveilnav.simulator.hardware.rtsp import JpegScan, RtspServer
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings

_PICTURES = 4


def main() -> None:
    """Renders what the cameras see, and serves it until SIGTERM."""
    settings, building = CameraHardwareSettings(), SimulatedBuilding(SimulationSettings())
    streams = {}
    for number, camera in enumerate(building.plan.cameras):
        pictures = fisheye.jpegs(fisheye.render(building, camera), _PICTURES, seed=number)
        streams[camera.name] = [JpegScan.from_jpeg(jpeg) for jpeg in pictures]

    def say_ready() -> None:
        print(f"the cameras are ready: {', '.join(streams) or 'none'}", flush=True)

    try:
        asyncio.run(RtspServer(streams, settings.fps).run(settings.host, settings.port, say_ready))
    except OSError as error:
        raise SurveilNavError(
            f"cameras can't listen at {settings.host}:{settings.port}: {error.strerror}. "
            "SURVEILNAV_CAMERA_HARDWARE__PORT chooses another port"
        ) from None


if __name__ == "__main__":
    sys.exit(run_service(main))
