"""The addresses of the system as a whole: building, emergency stop, traffic, services, metrics, health and readiness."""

from __future__ import annotations

import csv
import io
from typing import Annotated

from fastapi import APIRouter, Body, Query, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from surveilnav.rest import (
    ROOT,
    Building,
    Items,
    Readiness,
    RobotHalt,
    Service,
    Traffic,
    TrafficOverTime,
    TrafficStep,
)
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.traffic_series import LINKS
from surveilnav.services.gateway.metrics import building_metrics
from surveilnav.services.gateway.responses import Limit, Offset, Responses, page_of
from surveilnav.services.gateway.service import Gateway

LastSeconds = Annotated[float, Query(gt=0, le=30 * 86400, description="How long ago the series begins [s]")]
_CSV: Responses = {
    200: {"description": "comma-separated values", "content": {"text/csv": {"schema": {"type": "string"}}}}
}
_METRICS: Responses = {
    200: {"description": "the text format of Prometheus", "content": {"text/plain": {"schema": {"type": "string"}}}}
}


def router(gateway: Gateway) -> APIRouter:
    """The building, the emergency stop, traffic, services, health and readiness."""
    router = APIRouter()

    @router.get(f"{ROOT}/buildings", tags=["building"])
    def buildings(limit: Limit = 100, offset: Offset = 0) -> Items[Building]:
        """The buildings that this gateway serves: one."""
        return page_of([gateway.building()], limit, offset)

    @router.post(f"{ROOT}/robots/stop", tags=["building"])
    def stop(reason: Annotated[str, Body(embed=True, max_length=200)] = "") -> Items[RobotHalt]:
        """EMERGENCY STOP: every robot stops at once, whoever drives it, and refuses to move until it is released. All
        missions are paused."""
        return page_of(gateway.stop_robots(reason))

    @router.get(f"{ROOT}/traffic", tags=["building"])
    def traffic() -> Traffic:
        """Bytes offered, delivered and on the wire."""
        return gateway.traffic(asks=True)

    @router.get(f"{ROOT}/traffic/series", tags=["building"])
    def traffic_series(step: TrafficStep = "minute", last_s: LastSeconds = 3600.0) -> TrafficOverTime:
        """Offered bytes by link over time. Seconds are kept for an hour, minutes for thirty days, since this gateway began."""
        return gateway.meter.series(step, last_s)

    @router.get(f"{ROOT}/traffic/series.csv", tags=["building"], response_class=Response, responses=_CSV)
    def traffic_series_csv(step: TrafficStep = "minute", last_s: LastSeconds = 3600.0) -> Response:
        """The same as a table, a line for each step."""
        rows = [point.model_dump(mode="json") for point in gateway.meter.series(step, last_s).points]
        out = io.StringIO()
        table = csv.DictWriter(out, ["at", *(f"{link}_bytes" for link in LINKS)])
        table.writeheader()
        table.writerows(rows)
        return Response(out.getvalue(), media_type="text/csv")

    @router.get(f"{ROOT}/services", tags=["health"])
    def services(limit: Limit = 100, offset: Offset = 0) -> Items[Service]:
        """The processes that `surveilnav up` keeps running, and how often each was restarted. Not with Docker Compose."""
        return page_of(gateway.services(), limit, offset)

    @router.get("/metrics", tags=["health"], response_class=Response, responses=_METRICS)
    def metrics() -> Response:
        """All metrics, for Prometheus."""
        return Response(generate_latest(building_metrics(gateway)), media_type=CONTENT_TYPE_LATEST)

    @router.get("/healthz", tags=["health"])
    def healthz() -> dict[str, str]:
        """Says that this process is alive. /readyz says whether a mission could run."""
        return {"status": "ok"}

    @router.get("/readyz", tags=["health"])
    def readyz() -> Readiness:
        """Whether a mission could run now: status 200, or 503 with what is missing."""
        readiness = gateway.readiness()
        if not readiness.ready:
            raise Problem(503, "not_ready", f"missing: {', '.join(readiness.missing)}", **readiness.model_dump())
        return readiness

    return router
