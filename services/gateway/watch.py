"""Hears what changes in the building, and tells the log of events."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from surveilnav import contract
from surveilnav.bus import Received, clock_ns
from surveilnav.errors import SurveilNavError
from surveilnav.messages import MissionStatus, ObjectRecord, ServiceState
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core import changes
from surveilnav.services.gateway.core.changes import CameraState, Change, RobotSituation, Tracked
from surveilnav.services.gateway.core.resources import Object
from surveilnav.services.gateway.core.resources.event import Event
from surveilnav.services.gateway.costs import MissionCosts
from surveilnav.services.gateway.events import Events
from surveilnav.services.gateway.sources import Sources
from surveilnav.services.gateway.state import BuildingState

#: So often all is compared with what it was. Missions tell of each change themselves.
_LOOK_S = 0.5
#: So seldom fusion is asked for its objects, and only where its maps changed.
_OBJECTS_S = 2.0
_SERVICES = ("planner", "fusion", "perception")


class Watch:
    """Compares the state of the building with what it was, on a thread of its own, until the node ends."""

    def __init__(
        self,
        state: BuildingState,
        cameras: Cameras,
        sources: Sources,
        events: Events,
        costs: MissionCosts,
        on_objects: Callable[[], None] = lambda: None,
    ) -> None:
        """``on_objects`` is called before it is told that objects changed: who kept them asks anew."""
        self._state, self._node = state, state.node
        self._all_cameras, self._sources, self._events, self._costs = cameras, sources, events, costs
        self._on_objects = on_objects
        self._lock = threading.Lock()  # missions are told of by the bus's thread, too
        self._presence: Tracked[bool] = Tracked(changes.of_presence)
        self.clear()
        state.missions.on_message = self._on_mission
        self._missions.update({id: row.message for id, row in state.missions.newest("mission").items()})
        self.look()
        threading.Thread(target=self._run, name="watch", daemon=True).start()

    def clear(self) -> None:
        """Begins anew, as after a start: a replay was taken to another moment."""
        with self._lock:
            self._missions: Tracked[MissionStatus] = Tracked(changes.of_mission)
        self._cameras: Tracked[CameraState] = Tracked(changes.of_camera)
        self._robots: Tracked[RobotSituation] = Tracked(changes.of_robot)
        self._processes: Tracked[ServiceState] = Tracked(changes.of_process)
        self._objects: dict[str, Tracked[ObjectRecord]] = {}
        self._objects_at: dict[str, tuple[float, int]] = {}
        #: By floor and id, as fusion last told of them, without their histories.
        self.objects: dict[str, dict[str, Object]] = {}

    def _run(self) -> None:
        while not self._node.stopping.wait(_LOOK_S):
            try:
                self.look()
                for floor, row in self._state.revisions.newest("floor").items():
                    self._look_at_objects(floor, row.message.stamp_ns)
            except Exception:  # a bug must not end the events in silence
                if not self._node.stopping.is_set():
                    self._node.log.exception("watching failed")

    def look(self) -> None:
        """Compares all but the objects with what was, and counts what missions cost."""
        self._costs.look()
        for row in self._state.missions.newest("mission").values():
            self._on_mission(row)
        self._tell("camera", self._cameras.update(self._camera_states()), Event.of_camera)
        self._tell("robot", self._robots.update(self._robot_situations()), Event.of_robot)
        self._tell("service", self._processes.update(self._process_states()), Event.of_process)
        here = {f"{kind}/{id}": True for kind in _SERVICES for id in self._node.alive(kind)}
        self._tell("service", self._presence.update(here), Event.of_presence)

    def _on_mission(self, row: Received[MissionStatus]) -> None:
        status, id = row.message, row.ids["mission"]
        with self._lock:
            known = self._missions.get(id)
            if status.mission == id and (known is None or known.stamp_ns < status.stamp_ns):
                self._tell("mission", self._missions.update_one(id, status), Event.of_mission)

    def _camera_states(self) -> dict[str, CameraState]:
        return {
            c.id: CameraState(floor=c.floor, online=not c.stale, invoked=c.invoked, paused=c.paused)
            for c in self._all_cameras.all()
        }

    def _robot_situations(self) -> dict[str, RobotSituation]:
        return {
            r.id: RobotSituation(online=not r.stale, state=r.state, floor=r.floor, message=r.message)
            for r in self._sources.robots()
        }

    def _process_states(self) -> dict[str, ServiceState]:
        rows = self._state.services.newest("supervisor").values()
        return {state.name: state for row in rows for state in row.message.services}

    def _look_at_objects(self, floor: str, stamp_ns: int) -> None:
        """Asks for a floor's objects if its maps changed; where fusion doesn't answer, a later look asks again."""
        asked_s, seen_ns = self._objects_at.get(floor, (-_OBJECTS_S, 0))
        now_s = time.monotonic()
        if stamp_ns == seen_ns or now_s - asked_s < _OBJECTS_S or not self._state.alive("fusion"):
            return
        self._objects_at[floor] = now_s, seen_ns
        try:
            row = self._node.ask(contract.OBJECTS, parameters={"detail": "brief"}, floor=floor, timeout_s=_OBJECTS_S)
        except SurveilNavError as error:
            self._node.warn_seldom("can't hear of objects", floor=floor, error=str(error))
            return
        self._objects_at[floor] = now_s, stamp_ns
        self.objects[floor] = {f"{floor}/{o.id}": Object.from_record(o) for o in row.message.objects}
        tracked = self._objects.setdefault(floor, Tracked(changes.of_object))
        if changed := tracked.update({str(o.id): o for o in row.message.objects}):
            self._on_objects()
            self._tell("object", changed, Event.of_object)

    def _tell(self, kind: str, found: list[Change[Any]], event: Callable[[Change[Any], int], Event]) -> None:
        for change in found:
            self._events.publish(kind, event(change, clock_ns()).line())
