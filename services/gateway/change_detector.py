"""Compares the state of the building with the previous one regularly, and publishes each change as an event."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from surveilnav import contract
from surveilnav.bus import Received, clock_ns
from surveilnav.errors import SurveilNavError
from surveilnav.messages import MapRemoval, MissionStatus, ObjectRecord, ServiceState
from surveilnav.rest import Event, Object
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core import changes
from surveilnav.services.gateway.core.changes import CameraState, Change, RobotSituation, Tracked
from surveilnav.services.gateway.core.resources import object_from_record
from surveilnav.services.gateway.objects import Objects
from surveilnav.services.gateway.removals import Removals
from surveilnav.services.gateway.robots import Robots
from surveilnav.services.gateway.state import BuildingState
from surveilnav.services.gateway.stream_sources import BuildingEvents
from surveilnav.services.gateway.traffic import TrafficMeter

#: How often everything is compared. Changes of missions are noticed at once, from their messages.
_COMPARE_PERIOD_S = 0.5
#: Minimum time between two requests for the objects of a floor, which are only made if its maps have changed.
_OBJECTS_PERIOD_S = 2.0
#: So often they are requested although the revision is the same: after a restart of fusion it may mean other maps.
_OBJECTS_REFRESH_S = 60.0
_SERVICES = ("planner", "fusion", "perception")


class ChangeDetector:
    """Compares the state of the building with the previous one, on its own thread, until the node ends.

    Attributes:
        brief_objects: by floor and by "floor/id", as fusion last reported them, without their histories.
    """

    def __init__(
        self,
        state: BuildingState,
        cameras: Cameras,
        robots: Robots,
        objects: Objects,
        removals: Removals,
        events: BuildingEvents,
        meter: TrafficMeter,
    ) -> None:
        self._state, self._node = state, state.node
        self._all_cameras, self._all_robots, self._all_objects = cameras, robots, objects
        self._all_removals = removals
        self._events, self._meter = events, meter
        self._lock = threading.Lock()  # missions are also reported on the bus's thread
        self._presence: Tracked[bool] = Tracked(changes.presence_changes)
        self.clear()
        state.missions.on_message = self._on_mission
        self._missions.update({id: row.message for id, row in state.missions.newest("mission").items()})
        self.compare()
        threading.Thread(target=self._run, name="change detector", daemon=True).start()

    def clear(self) -> None:
        """Forgets the previous state, because a replay jumped to another moment."""
        with self._lock:
            self._missions: Tracked[MissionStatus] = Tracked(changes.mission_changes)
        self._cameras: Tracked[CameraState] = Tracked(changes.camera_changes)
        self._removals: Tracked[MapRemoval] = Tracked(changes.removal_changes)
        self._robots: Tracked[RobotSituation] = Tracked(changes.robot_changes)
        self._processes: Tracked[ServiceState] = Tracked(changes.process_changes)
        self._objects: dict[str, Tracked[ObjectRecord]] = {}
        #: When a floor's objects were last requested [monotonic s], and the revision they are of.
        self._objects_read: dict[str, tuple[float, int]] = {}
        self.brief_objects: dict[str, dict[str, Object]] = {}

    def _run(self) -> None:
        while not self._node.stopping.wait(_COMPARE_PERIOD_S):
            try:
                self.compare()
                revisions = self._state.revisions.newest("floor")
                for floor, row in revisions.items():
                    self._compare_objects(floor, row.message.revision)
                for floor in self.brief_objects.keys() - revisions.keys():  # only a source that was removed had seen it
                    self.brief_objects.pop(floor)
            except Exception:  # a bug must not end the events in silence
                if not self._node.stopping.is_set():
                    self._node.log.exception("watching failed")

    def compare(self) -> None:
        """Compares everything but objects with the previous state, and updates the traffic of missions."""
        self._meter.update()
        for row in self._state.missions.newest("mission").values():
            self._on_mission(row)
        self._publish("camera", self._cameras.update(self._camera_states()), changes.camera_event)
        self._all_removals.forget_outdated()
        removals = self._all_removals.messages()
        self._publish("removal", self._removals.update(removals), changes.removal_event)
        self._publish("robot", self._robots.update(self._robot_situations()), changes.robot_event)
        self._publish("service", self._processes.update(self._process_states()), changes.process_event)
        alive = {f"{kind}/{id}": True for kind in _SERVICES for id in self._node.alive(kind)}
        self._publish("service", self._presence.update(alive), changes.presence_event)

    def _on_mission(self, row: Received[MissionStatus]) -> None:
        status, id = row.message, row.ids["mission"]
        with self._lock:
            known = self._missions.get(id)
            if status.mission == id and (known is None or known.stamp_ns < status.stamp_ns):
                self._publish("mission", self._missions.update_one(id, status), changes.mission_event)

    def _camera_states(self) -> dict[str, CameraState]:
        return {
            c.id: CameraState(
                floor=c.floor,
                online=not c.stale,
                invoked=c.invoked,
                paused=c.paused,
                stream=c.stream.state,
                quarantined=bool(c.quarantine),
            )
            for c in self._all_cameras.all()
        }

    def _robot_situations(self) -> dict[str, RobotSituation]:
        return {
            r.id: RobotSituation(
                online=not r.stale, state=r.state, floor=r.floor, message=r.message, frame_problem=r.frame_problem
            )
            for r in self._all_robots.all()
        }

    def _process_states(self) -> dict[str, ServiceState]:
        rows = self._state.services.newest("supervisor").values()
        return {state.name: state for row in rows for state in row.message.services}

    def _compare_objects(self, floor: str, revision: int) -> None:
        """Requests a floor's objects if its maps have changed, and compares them. If fusion is silent, a later call retries."""
        requested_s, known = self._objects_read.get(floor, (-math.inf, -1))
        now_s = time.monotonic()
        period_s = _OBJECTS_REFRESH_S if revision == known else _OBJECTS_PERIOD_S
        if now_s - requested_s < period_s or not self._state.alive("fusion"):
            return
        self._objects_read[floor] = now_s, known
        try:
            row = self._node.ask(
                contract.OBJECTS, parameters={"detail": "brief"}, floor=floor, timeout_s=_OBJECTS_PERIOD_S
            )
        except SurveilNavError as error:
            self._node.warn_seldom("can't hear of objects", floor=floor, error=str(error))
            return
        self._objects_read[floor] = now_s, revision
        self.brief_objects[floor] = {f"{floor}/{o.id}": object_from_record(o) for o in row.message.objects}
        tracked = self._objects.setdefault(floor, Tracked(changes.object_changes))
        if found := tracked.update({str(o.id): o for o in row.message.objects}):
            self._all_objects.clear()  # before the events, so that a client that then reads the list gets the new state
            self._publish("object", found, changes.object_event)

    def _publish(self, kind: str, found: list[Change[Any]], event_of: Callable[[Change[Any], int], Event]) -> None:
        for change in found:
            event = event_of(change, clock_ns())
            self._events.publish(kind, event.model_dump_json(exclude_none=True))
