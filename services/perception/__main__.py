"""``python -m surveilnav.services.perception``: one perception worker."""

from __future__ import annotations

import sys
import threading
from dataclasses import fields
from typing import Any

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
    networks = {field.name: getattr(settings, field.name) for field in fields(NetworkSettings)}
    backend = choose_backend(settings.backend, simulated=settings.simulated, seed=settings.seed, **networks)
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


def choose_backend(name: str, *, simulated: bool, seed: int, **networks: Any) -> Backend:
    """The backend of that name. The simulator, which has some of its own, is loaded only in a simulated building."""
    if simulated or name in ("oracle", "simulated"):
        from surveilnav.simulator.truth.choose import choose_backend as choose_any

        return choose_any(name, seed=seed, simulated=simulated, **networks)
    return choose.choose_backend(name, NetworkSettings(**networks))


if __name__ == "__main__":
    sys.exit(run_service(main))
