"""``python -m services.camera_node``: one simulated surveillance camera."""

from __future__ import annotations

import sys
import time

from services.camera_node.config import CameraSettings
from services.camera_node.eyes import open_eyes
from services.camera_node.service import CameraService
from services.camera_node.slots import lease, named
from simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service
from surveilnav.perception import Backend


def main() -> None:
    settings, bus = CameraSettings(), BusSettings()
    building = SimulatedBuilding(SimulationSettings())
    if settings.id:
        camera = named(building.plan, settings.id)
        node = Node("camera", camera.name, bus).__enter__()
    else:
        camera, node = _leased(building, bus)
    with node:
        service = CameraService(node, building, camera, settings)
        eyes = open_eyes(
            node, building, camera, settings, lambda: service.sending, lambda: _backend(building, settings)
        )
        try:
            node.run(service.step, idle_s=0.02)
        finally:
            if eyes is not None:
                eyes.close()


def _backend(building: SimulatedBuilding, settings: CameraSettings) -> Backend:
    from simulator.truth.choose import choose_backend  # the networks' runtime: only where somebody looks

    return choose_backend(
        settings.perception, threads=settings.threads, seed=building.settings.seed, download=settings.download
    )


def _leased(building: SimulatedBuilding, bus: BusSettings):  # type: ignore[no-untyped-def]
    """A camera of the plan, however long that takes: a spare replica waits, healthy, for a slot to fall free."""
    said = False
    while (found := lease(building.plan, bus)) is None:
        if not said:
            print(
                f"camera: all {len(building.plan.cameras)} slots of the plan are taken; waiting for one",
                file=sys.stderr,
            )
            said = True
        if bus.health_file:
            bus.health_file.parent.mkdir(parents=True, exist_ok=True)
            bus.health_file.touch()
        time.sleep(2.0)
    return found


if __name__ == "__main__":
    sys.exit(run_service(main))
