"""The gateway's side of the bus: it remembers what is put, asks for the rest, and turns it into resources.

Calls block for as long as the contract says that an answer may take: run them on threads. What can't be had is a
``Problem``.
"""

from __future__ import annotations

import threading
from collections import ChainMap
from collections.abc import Callable

from surveilnav.bus import Node
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core.metrics import Heard
from surveilnav.services.gateway.core.resources import NEEDED, Building, Readiness, RobotHalt, Service, Traffic
from surveilnav.services.gateway.core.traffic import sum_traffic
from surveilnav.services.gateway.costs import MissionCosts
from surveilnav.services.gateway.events import Events
from surveilnav.services.gateway.live import Live, Things
from surveilnav.services.gateway.looks import Looks
from surveilnav.services.gateway.maps import Maps
from surveilnav.services.gateway.missions import Missions
from surveilnav.services.gateway.objects import Objects
from surveilnav.services.gateway.pictures import Pictures
from surveilnav.services.gateway.recordings import Recordings
from surveilnav.services.gateway.replays import Replays
from surveilnav.services.gateway.sources import Sources
from surveilnav.services.gateway.state import BuildingState
from surveilnav.services.gateway.tiles import Tiles
from surveilnav.services.gateway.watch import Watch

#: The newest; older ones are had by REST.
_MISSIONS_SHOWN = 100


class Gateway:
    """All that the web side may ask for, a part for each kind of resource, and the whole: building, traffic, readiness."""

    def __init__(self, node: Node, root_path: str = "", looks: Looks | None = None) -> None:
        """``root_path``: where a proxy has the gateway, such as /surveilnav; "": at the top."""
        self._node = node
        self.looks = looks or Looks()
        self._state = BuildingState(node, root_path)
        self.missions = Missions(self._state)
        self.cameras = Cameras(self._state)
        self.pictures = Pictures(node, self.cameras.thumbnails, self.looks)
        self.sources = Sources(self._state)
        self.maps = Maps(self._state, self.cameras, self.sources, self.missions)
        self.objects = Objects(self._state)
        self.recordings = Recordings(self._state)
        self.events = Events()
        self.costs = MissionCosts(self._state, self.missions)
        self._watch = Watch(self._state, self.cameras, self.sources, self.events, self.costs, self.objects.clear)
        self.replays = Replays(self._state, (self._state, self.costs, self._watch, self.maps, self.objects))
        self.live = Live(node, self._shown())
        self.tiles = Tiles(node, self.cameras)

    def _shown(self) -> dict[str, Callable[[], Things]]:
        """What streams tell of, by kind, and where it comes from."""
        return {
            "building": lambda: {"": self.building()},
            "readiness": lambda: {"": self.readiness()},
            "floor": lambda: {f.id: f for f in self.maps.floors()},
            "camera": lambda: {c.id: c for c in self.cameras.all()},
            "robot": lambda: {r.id: r for r in self.sources.robots()},
            "worker": lambda: {w.id: w for w in self.sources.workers()},
            "recorder": lambda: {r.id: r for r in self.recordings.recorders()},
            "service": lambda: {s.id: s for s in self.services()},
            "mission": lambda: {m.id: m for m in self.missions.all()[:_MISSIONS_SHOWN]},
            "plan": lambda: {p.mission: p for p in self.missions.plans()},
            "cost": self.costs.all,
            "object": lambda: dict(ChainMap(*self._watch.objects.values())),
            "traffic": lambda: self.traffic().by_source(),
            "replay": lambda: {"": found} if (found := self.replays.shown()) else {},
        }

    def building(self) -> Building:
        """The building, with what is in it."""
        inside = self.maps.floors(), self.cameras.all(), self.sources.robots(), self.missions.all()
        return Building.of(self._node.building, *inside, ready=self.readiness().ready)

    def stop_robots(self, reason: str) -> list[RobotHalt]:
        """Emergency stop: robots first, and missions pause meanwhile, also those of robots that don't answer."""
        why = f"emergency stop{f': {reason}' if reason else ''}"
        threading.Thread(target=self.missions.pause_all, args=(why,), name="emergency-stop", daemon=True).start()
        return self.sources.halt(True, reason)

    def traffic(self) -> Traffic:
        """What every node counted, summed by node, camera and robot."""
        rows = {f"{r.message.kind}/{r.message.node}": r for r in self._state.traffic.rows()}
        heard = {name: (row.received_ns, self._state.traffic.old(row)) for name, row in rows.items()}
        return Traffic.from_sums(sum_traffic(r.message for r in rows.values()), heard)

    def services(self) -> list[Service]:
        """Processes that are kept running, as `surveilnav up` tells."""
        told = self._state.services
        return [
            Service.from_state(state, row.received_ns, told.old(row))
            for row in told.newest("supervisor").values()
            for state in row.message.services
        ]

    def heard(self) -> Heard:
        """What metrics are made of."""
        alive, loads = self._node.alive("perception"), self._state.loads
        workers = {id: (row.message, id not in alive or loads.old(row)) for id, row in loads.newest("worker").items()}
        return Heard(
            cameras=self.cameras.all(),
            floors=self.maps.floors(),
            robots=self.sources.robots(),
            missions=self.missions.all(),
            processes=self.services(),
            workers=workers,
            traffic=self.traffic(),
            recorders=self.recordings.recorders(),
            ready=self.readiness().ready,
            event_streams=self.events.streams,
            events=self.events.newest,
        )

    def readiness(self) -> Readiness:
        """Whether a mission could run now, and what is missing."""
        routers = self._node.routers()
        return Readiness.of(routers, {kind: self._node.alive(kind) for kind, _ in NEEDED})
