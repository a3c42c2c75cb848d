"""``python -m surveilnav.services.camera_node``: one simulated surveillance camera."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service
from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.perception.backend import Backend
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.edge_perception import open_edge_perception
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.slots import find_camera, lease
from surveilnav.services.camera_node.sources.simulated import SimulatedSource
from surveilnav.services.camera_node.zones import read_zones
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


def main() -> None:
    """Runs one simulated camera until SIGTERM."""
    settings, bus = CameraSettings(), BusSettings()
    building = SimulatedBuilding(SimulationSettings())
    plan = building.plan
    if settings.masks:  # checked before a camera is leased: zones of a misspelt camera name would mask nothing
        read_zones(Path(settings.masks), "", 0, [camera.name for camera in plan.cameras])
    with _camera_and_node(plan, settings, bus) as (camera, node):
        source = SimulatedSource(building, camera)
        service = CameraService(node, source, settings)
        with open_edge_perception(
            node,
            source,
            settings,
            n_floors=len(plan.floors),
            load=lambda: _backend(building, settings),
            busy=lambda: service.sending or service.paused,
        ):
            node.run(service.step, idle_s=0.02)


@contextmanager
def _camera_and_node(
    plan: CameraPlan, settings: CameraSettings, bus: BusSettings
) -> Iterator[tuple[PlannedCamera, Node]]:
    """The camera named in the settings and its node; without a name, any free camera, however long it takes to get one."""
    if settings.id:
        camera = find_camera(plan, settings.id)
        with Node("camera", camera.name, bus) as node:
            yield camera, node
        return
    announced = False
    while True:
        with lease(plan, bus) as leased:
            if leased is not None:
                yield leased
                return
        if not announced:
            print(f"camera: all {len(plan.cameras)} slots of the plan are taken; waiting for one", file=sys.stderr)
            announced = True
        _touch_health_file(bus)
        time.sleep(2.0)


def _touch_health_file(bus: BusSettings) -> None:
    """Reports a spare replica, which waits for a slot to become free, as healthy."""
    if bus.health_file:
        bus.health_file.parent.mkdir(parents=True, exist_ok=True)
        bus.health_file.touch()


def _backend(building: SimulatedBuilding, settings: CameraSettings) -> Backend:
    from surveilnav.simulator.truth.choose import choose_backend  # loads ONNX Runtime, which few cameras need

    return choose_backend(
        settings.perception, threads=settings.threads, seed=building.settings.seed, download=settings.download
    )


if __name__ == "__main__":
    sys.exit(run_service(main))
