"""The state of the building as metrics for Prometheus."""

from __future__ import annotations

from surveilnav.services.gateway.core.metrics import BuildingMetrics
from surveilnav.services.gateway.service import Gateway


def building_metrics(gateway: Gateway) -> BuildingMetrics:
    """What there is now, as ``core.metrics`` puts it into Prometheus' format."""
    state = gateway.state
    alive = state.node.alive("perception")
    workers = {
        id: (row.message, id not in alive or state.loads.is_old(row))
        for id, row in state.loads.newest("worker").items()
    }
    return BuildingMetrics(
        cameras=gateway.cameras.all(),
        floors=gateway.maps.floors(),
        robots=gateway.robots.all(),
        missions=gateway.missions.all(),
        processes=gateway.services(),
        workers=workers,
        traffic=gateway.traffic(),
        recorders=gateway.recordings.recorders(),
        ready=gateway.readiness().ready,
        event_streams=gateway.events.n_streams,
        events=gateway.events.newest,
    )
