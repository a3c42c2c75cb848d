"""The planner service: accepts missions, gives each a robot and a thread, and reports on them.

With a store, missions that a killed planner was working on are resumed when it starts again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from surveilnav.bus import Answer, Node, Refused, Request
from surveilnav.contract import MISSION_CANCEL, MISSION_GOAL, MISSION_PAUSE, MISSION_PLAN, MISSION_STATUS
from surveilnav.errors import MissionError
from surveilnav.messages import MissionCancel, MissionGoal, MissionPause
from surveilnav.services.planner.acks import acknowledged, refused
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.mission_registry import MissionRegistry
from surveilnav.services.planner.mission_runner import MissionRunner

_CANCEL_WAIT_S = _PAUSE_WAIT_S = 3.0
_RETRY_SAVING_S = 2.0
_ASSIGN_S = 0.2


class PlannerService:
    """Answers goals, cancels, and questions about missions."""

    def __init__(self, node: Node, settings: PlannerSettings) -> None:
        for kind in ("robot", "fusion", "perception"):
            node.alive(kind)  # the first call starts watching
        self._node, self._missions = node, MissionRegistry(node, settings)
        self._saved_s = self._assigned_s = time.monotonic()
        node.serve(MISSION_GOAL, self._on_goal)
        node.serve(MISSION_CANCEL, lambda request: self._if_open(request, self._cancel), workers=2)
        node.serve(MISSION_PAUSE, lambda request: self._if_open(request, self._pause), workers=2)
        node.serve(MISSION_STATUS, lambda request: self._answer(request, _status_of))
        node.serve(MISSION_PLAN, lambda request: self._answer(request, _plan_of))

    def step(self) -> bool:
        """Assigns robots to queued missions, and retries what the store couldn't write. Missions run on their own threads."""
        now_s = time.monotonic()
        if now_s - self._assigned_s >= _ASSIGN_S:
            self._assigned_s = now_s
            self._missions.refresh_areas()
            self._missions.assign_robots()
        if now_s - self._saved_s >= _RETRY_SAVING_S:
            self._saved_s = now_s
            self._missions.retry_saving()
            self._missions.end_lost()
        return False

    def _on_goal(self, request: Request) -> Answer:
        goal: MissionGoal = request.message
        try:
            if goal.mission != (id := request.ids["mission"]):
                agree = f"the key names mission {id!r}, the goal {goal.mission!r}: they must agree"
                raise MissionError("bad_goal", agree)
            mission = self._missions.accept(goal)
        except MissionError as error:
            return refused(goal.mission, error.name, str(error))
        return acknowledged(mission, accepted=True)

    def _if_open(self, request: Request, act: Callable[[MissionRunner, Any], Answer]) -> Answer:
        """Has ``act`` answer a message about an open mission; refuses one about an unknown mission or one that has ended."""
        id = request.ids["mission"]
        mission = self._missions.get(id)
        if mission is None:
            return refused(request.message.mission, "unknown_mission", f"no mission {id!r} is known here")
        if mission.finished:
            return acknowledged(mission, accepted=False, message=f"it is {mission.status.state} already")
        return act(mission, request.message)

    def _cancel(self, mission: MissionRunner, cancel: MissionCancel) -> Answer:
        mission.cancel(cancel.reason, _CANCEL_WAIT_S)
        return acknowledged(mission, accepted=True)

    def _pause(self, mission: MissionRunner, wanted: MissionPause) -> Answer:
        """Pauses or resumes a mission, and waits up to three seconds until it is paused or active."""
        if mission.is_queued:
            why = f"mission {mission.id!r} has no robot yet, so there is nothing to pause; cancel it instead"
            return refused(mission.id, "not_begun", why)
        if not wanted.paused and self._missions.is_halted(mission.robot):
            return refused(mission.id, "robot_halted", f"robot {mission.robot!r} is halted: release it first")
        mission.pause(wanted.reason) if wanted.paused else mission.resume()
        mission.wait_until(paused=wanted.paused, at_most_s=_PAUSE_WAIT_S)
        return acknowledged(mission, accepted=True)

    def _answer(self, request: Request, what: Callable[[MissionRunner], Answer | None]) -> list[Answer]:
        """Answers for one mission, or for all if the key has a wildcard."""
        id = request.ids.get("mission", "*")
        if "*" in id:
            return [answer for m in self._missions.all() if (answer := what(m)) is not None]
        mission = self._missions.get(id)
        if mission is None:
            raise Refused("unknown_mission", f"no mission {id!r} is known here")
        answer = what(mission)
        if answer is None:
            raise Refused("no_plan", f"mission {id!r} has no plan yet")
        return [answer]


def _status_of(mission: MissionRunner) -> Answer | None:
    return Answer(mission.status, ids={"mission": mission.id})


def _plan_of(mission: MissionRunner) -> Answer | None:
    return None if mission.plan is None else Answer(mission.plan, ids={"mission": mission.id})
