"""Submitting, following, pausing and cancelling missions; the routes ``/missions``."""

from __future__ import annotations

import hashlib
import threading
import uuid
from collections import OrderedDict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Annotated

from fastapi import APIRouter, Body, Header, Response

from surveilnav import contract
from surveilnav.bus import Received, clock_ns, keep_request_id, request_id
from surveilnav.errors import SurveilNavError
from surveilnav.messages import (
    FINISHED_STATES,
    Judged,
    MissionAck,
    MissionCancel,
    MissionGoal,
    MissionPause,
    MissionStatus,
)
from surveilnav.rest import ROOT, GrowingItems, Mission, MissionPlan, MissionTraffic, NewMission
from surveilnav.services.gateway.bus_requests import request, request_existing
from surveilnav.services.gateway.core.missions import mission_from_ack, mission_from_status, plan_from_message
from surveilnav.services.gateway.core.problems import Problem, refusal
from surveilnav.services.gateway.core.selection import SortKey, page_after
from surveilnav.services.gateway.responses import Cursor, Id, Limit, Offset
from surveilnav.services.gateway.state import BuildingState
from surveilnav.services.gateway.traffic import TrafficMeter
from surveilnav.words import canonical

#: How many requests to pause a mission are under way at the same time, at an emergency stop.
_PAUSE_THREADS = 16
_MAX_KEYS = 10_000


class Missions:
    """All missions of the building, whoever submitted them."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node, self.root = state, state.node, state.root
        #: The goal and the mission that was made of it, by Idempotency-Key.
        self._submitted: OrderedDict[str, tuple[NewMission, Mission]] = OrderedDict()
        self._submit_lock = threading.Lock()

    # --- submitting -------------------------------------------------------------------------------------------------

    def submit(self, goal: NewMission, idempotency_key: str | None) -> Mission:
        """Sends a goal to the planner. A repeated key with the same goal returns the first mission, also after a restart."""
        if idempotency_key is None:
            return self._submit(f"m-{uuid.uuid4().hex[:12]}", goal)
        with self._submit_lock:  # of two requests with one key, the second waits for the mission of the first
            if known := self._submitted.get(idempotency_key):
                return _repeated(goal, known[0] == goal, known[1])
            id = "m-" + hashlib.sha256(f"{self._node.building}\0{idempotency_key}".encode()).hexdigest()[:16]
            if row := self._state.missions.newest("mission").get(id):  # submitted by a gateway before this one
                words = {canonical(row.message.target), canonical(row.message.asked)}
                return _repeated(goal, canonical(goal.target) in words, self._resource(row))
            mission = self._submit(id, goal)
            self._submitted[idempotency_key] = goal, mission
            if len(self._submitted) > _MAX_KEYS:
                self._submitted.popitem(last=False)
            return mission

    def _submit(self, id: str, goal: NewMission) -> Mission:
        message = MissionGoal(
            stamp_ns=clock_ns(),
            mission=id,
            target=goal.target,
            robot=goal.robot or "",
            max_steps=goal.max_steps,
            queue=goal.queue,
        )
        ack: MissionAck = request(self._node, "planner", contract.MISSION_GOAL, message, mission=id).message
        if not ack.accepted:
            raise refusal(ack.error, ack.message)
        return mission_from_ack(ack, goal, clock_ns(), request_id())

    # --- following --------------------------------------------------------------------------------------------------

    def all(self) -> list[Mission]:
        """All missions, newest first."""
        verdicts = self._state.judged.newest("mission")
        return [self._resource(row, verdicts) for row in self._rows()]

    def page(self, cursor: str | None, offset: int, limit: int) -> GrowingItems[Mission]:
        """At most ``limit`` missions, newest first, after a cursor or from ``offset``."""
        rows = self._rows()
        page, next_cursor = page_after(rows, _sort_key, cursor, offset, limit)
        verdicts = self._state.judged.newest("mission")
        items = [self._resource(row, verdicts) for row in page]
        return GrowingItems(items=items, total=len(rows), next=next_cursor)

    def get(self, id: str) -> Mission:
        """The mission as the planner last published it, else as it answers now. 404 if there is none."""
        row = self._state.missions.newest("mission").get(id)
        if row is None:  # accepted a moment ago, or before this gateway started
            row = request_existing(self._node, "mission", id, "planner", contract.MISSION_STATUS, mission=id)
        return self._resource(row)

    def plans(self) -> list[MissionPlan]:
        """The present plans of the missions under way."""
        alive = self._state.alive("planner")
        under_way = {
            id for id, row in self._state.missions.newest("mission").items() if row.message.state not in FINISHED_STATES
        }
        rows = self._state.plans.newest("mission").items()
        return [plan_from_message(row.message, row.received_ns, alive) for id, row in rows if id in under_way]

    def plan(self, id: str) -> MissionPlan:
        """The planner's present plan for a mission; 404 if it has none."""
        row = request_existing(self._node, "plan of mission", id, "planner", contract.MISSION_PLAN, mission=id)
        return plan_from_message(row.message, row.received_ns, self._state.alive("planner"))

    def _rows(self) -> list[Received[MissionStatus]]:
        return sorted(self._state.missions.newest("mission").values(), key=_sort_key)

    def _resource(
        self, row: Received[MissionStatus], verdicts: Mapping[str, Received[Judged]] | None = None
    ) -> Mission:
        """A mission as its planner reported it. ``verdicts``: the simulator's verdicts by mission; None: they are looked up."""
        verdicts = self._state.judged.newest("mission") if verdicts is None else verdicts
        judged = verdicts[row.message.mission].message.success if row.message.mission in verdicts else None
        return mission_from_status(row.message, row.received_ns, self._state.alive("planner"), judged)

    # --- changing ---------------------------------------------------------------------------------------------------

    def cancel(self, id: str, reason: str) -> Mission:
        """Asks the planner to end a mission; one that has ended can't be cancelled (409)."""
        message = MissionCancel(stamp_ns=clock_ns(), mission=id, reason=reason)
        return self._changed(id, request(self._node, "planner", contract.MISSION_CANCEL, message, mission=id).message)

    def pause(self, id: str, reason: str, *, paused: bool) -> Mission:
        """Pauses a mission or resumes it; one that has ended can be neither (409)."""
        message = MissionPause(stamp_ns=clock_ns(), mission=id, paused=paused, reason=reason)
        return self._changed(id, request(self._node, "planner", contract.MISSION_PAUSE, message, mission=id).message)

    def pause_all(self, reason: str) -> None:
        """Pauses all open missions concurrently. Failures are ignored, because halted robots don't move anyway."""

        def pause(id: str) -> None:
            with suppress(Problem, SurveilNavError):
                self.pause(id, reason, paused=True)

        under_way = [mission.id for mission in self.all() if not mission.has_ended]
        with ThreadPoolExecutor(_PAUSE_THREADS) as pool:
            list(pool.map(keep_request_id(pause), under_way))

    def _changed(self, id: str, ack: MissionAck) -> Mission:
        """The mission in the state that the planner's answer names. Problem: the planner refused the change."""
        if not ack.accepted:
            if ack.state in FINISHED_STATES and not ack.error:
                raise Problem(409, "finished", f"mission {id} is {ack.state} already; submit a new one")
            raise refusal(ack.error, ack.message)
        return self.get(id).model_copy(update={"state": ack.state})


def _sort_key(row: Received[MissionStatus]) -> SortKey:
    return -max(0, row.message.started_ns), row.ids["mission"]


def _repeated(goal: NewMission, same: bool, mission: Mission) -> Mission:
    """The mission that belongs to a repeated Idempotency-Key. Problem 422: it was used with another goal."""
    if same:
        return mission
    raise Problem(
        422,
        "idempotency_key_reused",
        f"this Idempotency-Key belongs to mission {mission.id} for another goal ({mission.target!r}); "
        f"send a new key for {goal.target!r}",
    )


def router(missions: Missions, meter: TrafficMeter) -> APIRouter:
    router = APIRouter(prefix=f"{ROOT}/missions", tags=["missions"])

    @router.post("", status_code=202)
    def submit(
        goal: NewMission,
        response: Response,
        idempotency_key: Annotated[str | None, Header(min_length=1, max_length=255)] = None,
    ) -> Mission:
        """Submits a mission. If a request with an Idempotency-Key is repeated, the answer is the first mission."""
        mission = missions.submit(goal, idempotency_key)
        response.headers["Location"] = f"{missions.root}/missions/{mission.id}"
        return mission

    @router.get("", name="missions")
    def list_missions(limit: Limit = 100, offset: Offset = 0, cursor: Cursor = None) -> GrowingItems[Mission]:
        """Missions, newest first. ``cursor`` is the ``next`` of the previous page. With it, the list continues exactly there,
        even if missions were submitted meanwhile."""
        return missions.page(cursor, offset, limit)

    @router.get("/{id}")
    def mission(id: Id) -> Mission:
        return missions.get(id)

    @router.post("/{id}/cancel", status_code=202)
    def cancel(id: Id, reason: Annotated[str, Body(embed=True, max_length=500)] = "") -> Mission:
        """Cancels a mission; its robot stops."""
        return missions.cancel(id, reason)

    @router.post("/{id}/pause", status_code=202)
    def pause(id: Id, reason: Annotated[str, Body(embed=True, max_length=500)] = "") -> Mission:
        """Pauses a mission: its robot finishes its action and stays where it is."""
        return missions.pause(id, reason, paused=True)

    @router.post("/{id}/resume", status_code=202)
    def resume(id: Id) -> Mission:
        """Resumes a paused mission."""
        return missions.pause(id, "", paused=False)

    @router.get("/{id}/plan")
    def plan(id: Id) -> MissionPlan:
        """The planner's present plan: the waypoint, the path, and the candidates that it was compared with."""
        return missions.plan(id)

    @router.get("/{id}/traffic")
    def traffic(id: Id) -> MissionTraffic:
        """What cameras and robots sent while the mission ran, and a forecast."""
        missions.get(id)  # 404 if there is no such mission
        return meter.one(id)

    return router
