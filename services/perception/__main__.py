"""``python -m surveilnav.services.perception``: one perception worker."""

from __future__ import annotations

import sys
import threading

import structlog

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service
from surveilnav.errors import PerceptionError
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.service import PerceptionService
from surveilnav.simulator.truth.choose import choose_backend


def main() -> None:
    """Runs one perception worker until SIGTERM. Raises PerceptionError if its backend fails the probe."""
    settings, bus = PerceptionSettings(), BusSettings()
    backend = choose_backend(
        settings.backend,
        detectors=settings.detectors,
        large_detectors=settings.large_detectors,
        detector=settings.detector,
        segmenter=settings.segmenter,
        embedder=settings.embedder,
        words_per_pass=settings.words_per_pass,
        threshold=settings.threshold,
        device=settings.device,
        compiled=settings.compiled,
        threads=settings.threads,
        seed=settings.seed,
        simulated=settings.simulated,
        download=settings.download,
    )
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


if __name__ == "__main__":
    sys.exit(run_service(main))
