"""Traffic on the bus: of every node, and of cameras and robots during each mission."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from datetime import UTC, datetime

from surveilnav.bus import Received
from surveilnav.messages import TrafficReport
from surveilnav.rest import MissionTraffic, Traffic, TrafficOverTime, TrafficPoint, TrafficStep
from surveilnav.services.gateway.core.mission_traffic import ByteCounts, MissionUsages
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.traffic import ReportAge, links_by_node, sum_traffic
from surveilnav.services.gateway.core.traffic_series import LINKS, TrafficSeries
from surveilnav.services.gateway.state import BuildingState

_STEPS_S: dict[TrafficStep, int] = {"second": 1, "minute": 60}


def present_traffic(state: BuildingState, *, asks: bool = False) -> Traffic:
    """The bytes that every node has counted, summed by node, camera and robot. ``asks``: nodes are asked for newer counts."""
    return _summed(state, _whole_reports(state, asks=asks))


def _summed(state: BuildingState, reports: Iterable[Received[TrafficReport]]) -> Traffic:
    rows = {f"{r.message.kind}/{r.message.node}": r for r in reports}
    received = {name: ReportAge(row.received_ns, state.traffic.is_old(row)) for name, row in rows.items()}
    return sum_traffic((row.message for row in rows.values()), received)


def _whole_reports(state: BuildingState, *, asks: bool = False) -> list[Received[TrafficReport]]:
    """The newest report of every node. Of a node of which only a part is known, none: it is asked for all."""
    rows = state.traffic.rows(asks=asks)
    if any(row.message.is_partial for row in rows) and not asks:
        rows = state.traffic.rows(asks=True)
    return [row for row in rows if not row.message.is_partial]


class TrafficMeter:
    """Counts bytes over time, and those of cameras and robots during each mission. Call ``update`` regularly. Thread-safe."""

    def __init__(self, state: BuildingState) -> None:
        self._state = state
        self._usages, self._series = MissionUsages(), TrafficSeries()
        self._lock = threading.Lock()

    def clear(self) -> None:
        """Forgets all counts, because a replay jumped to another moment."""
        with self._lock:
            self._usages, self._series = MissionUsages(), TrafficSeries()

    def update(self) -> None:
        """Adds what was sent since the last update."""
        reports = _whole_reports(self._state)
        counts = ByteCounts.from_traffic(_summed(self._state, reports))
        totals = links_by_node(row.message for row in reports)
        statuses = [row.message for row in self._state.missions.newest("mission").values()]
        with self._lock:
            self._usages.update(statuses, counts)
            self._series.record(totals, time.time())

    def series(self, step: TrafficStep, last_s: float) -> TrafficOverTime:
        """The bytes of each step of the last ``last_s`` seconds in which something was counted."""
        now_s = time.time()
        with self._lock:
            points = self._series.since(_STEPS_S[step], now_s - last_s, now_s)
        named = [f"{link}_bytes" for link in LINKS]
        return TrafficOverTime(
            step_s=_STEPS_S[step],
            points=[
                TrafficPoint(at=datetime.fromtimestamp(p.at_s, UTC), **dict(zip(named, p.n_bytes, strict=True)))
                for p in points
            ],
        )

    def all(self) -> dict[str, MissionTraffic]:
        """The traffic of the missions that ran while this gateway was running, by mission."""
        found = {}
        for id, row in self._state.missions.newest("mission").items():
            with self._lock:
                usage = self._usages.get(id)
                if usage is not None:
                    found[id] = usage.resource(row.message, row.received_ns)
        return found

    def one(self, id: str) -> MissionTraffic:
        """The traffic of one mission. Problem 404: it hasn't run while this gateway was running."""
        if (found := self.all().get(id)) is None:
            raise Problem(
                404, "no_traffic", f"mission {id} wasn't seen running: it waits, or ended before the gateway came"
            )
        return found
