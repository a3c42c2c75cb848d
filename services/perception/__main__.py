"""``python -m surveilnav.services.perception``: one perception worker."""

from __future__ import annotations

import sys
import threading
from dataclasses import fields

import structlog

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service
from surveilnav.errors import PerceptionError
from surveilnav.perception import choose
from surveilnav.perception.backend import Backend
from surveilnav.perception.presets import NetworkSettings
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.service import PerceptionService


def main() -> None:
    """Runs one perception worker until SIGTERM. Raises PerceptionError if its backend fails the probe."""
    settings, bus = PerceptionSettings(), BusSettings()
    backend = _backend(settings)
    structlog.get_logger().info("backend", backend=backend.name, why=backend.why)
    with Node("perception", settings.worker, bus) as node:
        service = PerceptionService(node, backend, settings)
        node.ready = lambda: service.ready
        errors: list[PerceptionError] = []

        def warm_up() -> None:
            try:
                service.warm_up()
            except PerceptionError as error:
                errors.append(error)
                node.stop()

        # On a thread of its own: meanwhile the node answers queries with "not_ready".
        threading.Thread(target=warm_up, name="warm-up", daemon=True).start()
        node.run(service.step, idle_s=0.2)
    if errors:
        raise errors[0]


def _backend(settings: PerceptionSettings) -> Backend:
    """The backend that the settings name. Only in a simulated building is the simulator loaded, which has some of its own."""
    networks = {field.name: getattr(settings, field.name) for field in fields(NetworkSettings)}
    if settings.simulated or settings.backend in ("oracle", "simulated"):
        from surveilnav.simulator.truth.choose import choose_backend

        return choose_backend(settings.backend, seed=settings.seed, simulated=settings.simulated, **networks)
    return choose.choose_backend(settings.backend, NetworkSettings(**networks))


if __name__ == "__main__":
    sys.exit(run_service(main))
