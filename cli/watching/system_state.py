"""The state of the running system as the gateway last reported it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime

from surveilnav.client import Client
from surveilnav.errors import GatewayError
from surveilnav.rest import Building, Camera, Floor, Mission, MissionPlan, Robot, Service, Traffic, Worker

#: Plans are read for this many missions.
_PLANS = 3


@dataclass(frozen=True, slots=True)
class SystemState:
    """The gateway's resources.

    Attributes:
        rates: bytes that a source offers per second, by "camera/id" or "robot/id".
        lost: since when the gateway doesn't answer; None while it does.
    """

    missions: list[Mission] = field(default_factory=list)
    plans: dict[str, MissionPlan] = field(default_factory=dict)
    robots: list[Robot] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    floors: list[Floor] = field(default_factory=list)
    buildings: list[Building] = field(default_factory=list)
    services: list[Service] = field(default_factory=list)
    perception: list[Worker] = field(default_factory=list)
    traffic: Traffic | None = None
    rates: dict[str, float] = field(default_factory=dict)
    lost: datetime | None = None

    @property
    def under_way(self) -> list[Mission]:
        """Missions that haven't ended, the newest first."""
        return [m for m in self.missions if not m.has_ended]


def read_moving(known: SystemState, gateway: Client) -> SystemState:
    """Reads anew what changes with every step: missions, plans, robots. Raises GatewayError."""
    new = replace(known, missions=gateway.missions(), robots=gateway.robots(), lost=None)
    plans = {}
    for mission in new.under_way[:_PLANS]:
        try:
            plans[mission.id] = gateway.plan(mission.id)
        except GatewayError as error:  # none yet, or its planner is gone
            if error.name == "no_gateway":
                raise
    return replace(new, plans=plans)


def read_rest(known: SystemState, gateway: Client, since_s: float) -> SystemState:
    """Reads anew all else. ``since_s``: how long ago that was last done, for the rates. Raises GatewayError."""
    traffic = gateway.traffic()
    return replace(
        known,
        cameras=gateway.cameras(),
        floors=gateway.floors(),
        buildings=gateway.buildings(),
        services=gateway.services(),
        perception=gateway.perception(),
        traffic=traffic,
        rates=_rates(known.traffic, traffic, since_s),
        lost=None,
    )


def _rates(before: Traffic | None, now: Traffic, since_s: float) -> dict[str, float]:
    """Bytes a second by source; a source that was started anew counts from 0."""
    if before is None or since_s <= 0:
        return {}
    old, new = _offered(before), _offered(now)
    return {name: max(0, count - old.get(name, 0)) / since_s for name, count in new.items()}


def _offered(traffic: Traffic) -> dict[str, int]:
    """Offered bytes by "camera/id" and "robot/id"."""
    sources = [("camera", s) for s in traffic.cameras] + [("robot", s) for s in traffic.robots]
    return {f"{kind}/{source.id}": source.offered_bytes for kind, source in sources}
