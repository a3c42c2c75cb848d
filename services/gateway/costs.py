"""What missions cost, counted as the reports of traffic come."""

from __future__ import annotations

import threading

from surveilnav.services.gateway.core.costs import Costs, Sums
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import MissionTraffic
from surveilnav.services.gateway.core.traffic import sum_traffic
from surveilnav.services.gateway.missions import Missions
from surveilnav.services.gateway.state import BuildingState


class MissionCosts:
    """Counts at every ``look``; asked from any thread."""

    def __init__(self, state: BuildingState, missions: Missions) -> None:
        self._state, self._missions = state, missions
        self._costs = Costs()
        self._lock = threading.Lock()

    def clear(self) -> None:
        """Counts anew: a replay was taken to another moment."""
        with self._lock:
            self._costs = Costs()

    def look(self) -> None:
        """Takes in what cameras and robots sent since the last look."""
        sums = Sums.of(sum_traffic(r.message for r in self._state.traffic.rows()))
        statuses = [row.message for row in self._state.missions.newest("mission").values()]
        with self._lock:
            self._costs.look(statuses, sums)

    def all(self) -> dict[str, MissionTraffic]:
        """Of the missions that are remembered and were seen running."""
        found = {}
        for id, row in self._state.missions.newest("mission").items():
            with self._lock:
                cost = self._costs.get(id)
                if cost is not None:
                    found[id] = MissionTraffic.of(cost, row.message, row.received_ns)
        return found

    def one(self, id: str) -> MissionTraffic:
        """Of one mission; 404 if there is none, or this gateway didn't see it run."""
        self._missions.get(id)
        if (found := self.all().get(id)) is None:
            raise Problem(
                404, "no_traffic", f"mission {id} wasn't seen running: it waits, or ended before the gateway came"
            )
        return found
