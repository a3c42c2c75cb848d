"""The gateway without HTTP: it remembers what is published on the bus, requests the rest, and makes resources of it.

Its methods may block until an answer arrives, so they are called on threads. They raise ``Problem`` if a request fails.
"""

from __future__ import annotations

import threading
from collections import ChainMap
from collections.abc import Callable

from surveilnav.bus import Node, keep_request_id
from surveilnav.rest import Building, Readiness, RobotHalt, Service, Traffic
from surveilnav.services.gateway.access_log import AccessLog
from surveilnav.services.gateway.areas import Areas
from surveilnav.services.gateway.cameras import Cameras, PastPictures
from surveilnav.services.gateway.change_detector import ChangeDetector
from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.core import resources
from surveilnav.services.gateway.maps import Maps
from surveilnav.services.gateway.missions import Missions
from surveilnav.services.gateway.objects import Objects
from surveilnav.services.gateway.recordings import Recordings, Replays
from surveilnav.services.gateway.removals import Removals
from surveilnav.services.gateway.robots import PerceptionWorkers, Robots
from surveilnav.services.gateway.sightings import CameraSightings
from surveilnav.services.gateway.state import BuildingState
from surveilnav.services.gateway.stream_sources import BuildingEvents, LiveStates, Resources
from surveilnav.services.gateway.tiles import CameraTiles
from surveilnav.services.gateway.traffic import TrafficMeter, present_traffic

#: How many of the newest missions /live sends. Older ones are listed by /missions.
_LIVE_MISSIONS = 100


class Gateway:
    """Everything that the routes use: an attribute for each kind of resource, and methods for those of the whole building.

    Args:
        node: the gateway's node on the bus.
        settings: of which it uses the path at which a proxy serves it, and the file of cameras.
        access_log: who was shown pictures; None: it is only kept in memory.
    """

    def __init__(self, node: Node, settings: GatewaySettings, access_log: AccessLog | None = None) -> None:
        self._node = node
        self.access_log = access_log or AccessLog()
        self.state = BuildingState(node, settings.root_path)
        self.missions = Missions(self.state)
        self.cameras = Cameras(self.state)
        self.pictures = PastPictures(node, self.cameras.thumbnails, self.access_log)
        self.robots = Robots(self.state)
        self.workers = PerceptionWorkers(self.state)
        self.maps = Maps(self.state, self.cameras, self.robots, self.missions)
        self.areas = Areas(self.state)
        self.objects = Objects(self.state)
        self.sightings = CameraSightings(self.state, self.objects, settings.cameras_file)
        self.recordings = Recordings(self.state)
        self.events = BuildingEvents()
        self.meter = TrafficMeter(self.state)
        self.removals = Removals(self.state, self.maps, self.objects)
        self._detector = ChangeDetector(
            self.state, self.cameras, self.robots, self.objects, self.removals, self.events, self.meter
        )
        self.replays = Replays(self.state, self._forget_everything)
        self.live = LiveStates(node, self._live_resources())
        self.tiles = CameraTiles(node, self.cameras)

    def _forget_everything(self) -> None:
        """Clears everything remembered, because a replay jumped and it may be from the replay's future."""
        for part in (self.state, self.meter, self._detector, self.maps, self.objects):
            part.clear()

    def _live_resources(self) -> dict[str, Callable[[], Resources]]:
        """What /live sends, by kind (as in ``surveilnav.rest.LIVE_RESOURCES``)."""
        return {
            "building": lambda: {"": self.building()},
            "readiness": lambda: {"": self.readiness()},
            "floor": lambda: {f.id: f for f in self.maps.floors()},
            "area": lambda: {a.id: a for a in self.areas.all()},
            "camera": lambda: {c.id: c for c in self.cameras.all()},
            "robot": lambda: {r.id: r for r in self.robots.all()},
            "worker": lambda: {w.id: w for w in self.workers.all()},
            "recorder": lambda: {r.id: r for r in self.recordings.recorders()},
            "service": lambda: {s.id: s for s in self.services()},
            "mission": lambda: {m.id: m for m in self.missions.all()[:_LIVE_MISSIONS]},
            "plan": lambda: {p.mission: p for p in self.missions.plans()},
            "cost": self.meter.all,
            "object": lambda: dict(ChainMap(*self._detector.brief_objects.values())),
            "traffic": lambda: self.traffic().by_source(),
            "removal": lambda: {r.id: r for r in self.removals.all()},
            "replay": lambda: {"": found} if (found := self.replays.current()) else {},
        }

    def building(self) -> Building:
        """The building, with what is in it."""
        parts = self.maps.floors(), self.cameras.all(), self.robots.all(), self.missions.all()
        return resources.building_from_parts(self._node.building, *parts, ready=self.readiness().ready)

    def stop_robots(self, reason: str) -> list[RobotHalt]:
        """Emergency stop: halts all robots; another thread pauses all missions, also those of robots that don't answer."""
        why = f"emergency stop{f': {reason}' if reason else ''}"
        pause_all = keep_request_id(self.missions.pause_all)
        threading.Thread(target=pause_all, args=(why,), name="emergency-stop", daemon=True).start()
        return self.robots.halt(True, reason)

    def traffic(self, *, asks: bool = False) -> Traffic:
        """What every node counted, summed by link, node, camera and robot. ``asks``: nodes are asked for newer counts."""
        return present_traffic(self.state, asks=asks)

    def services(self) -> list[Service]:
        """Processes that are kept running, as `surveilnav up` reports them."""
        rows, is_old = self.state.services.newest("supervisor").values(), self.state.services.is_old
        return [resources.service_from_state(s, r.received_ns, is_old(r)) for r in rows for s in r.message.services]

    def readiness(self) -> Readiness:
        """Whether a mission could run now, and what is missing."""
        return resources.readiness_from_nodes(
            self._node.routers(), {kind: self._node.alive(kind) for kind, _ in resources.NEEDED}
        )
