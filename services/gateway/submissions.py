"""Missions handed to the planner, each once."""

from __future__ import annotations

import hashlib
import threading
import uuid
from collections import OrderedDict
from collections.abc import Mapping

from surveilnav import contract
from surveilnav.bus import Received, clock_ns
from surveilnav.messages import Judged, MissionAck, MissionGoal, MissionStatus
from surveilnav.services.gateway.asking import ask
from surveilnav.services.gateway.core.problems import Problem, refusal
from surveilnav.services.gateway.core.resources import Mission, NewMission
from surveilnav.services.gateway.state import BuildingState
from surveilnav.words import canonical

_REMEMBERED_KEYS = 10_000


def told(
    row: Received[MissionStatus], state: BuildingState, verdicts: Mapping[str, Received[Judged]] | None = None
) -> Mission:
    """A mission as its planner told of it. ``verdicts``: what a simulator says of stops, by mission, if that is at hand."""
    verdicts = state.judged.newest("mission") if verdicts is None else verdicts
    judged = verdicts[row.message.mission].message.success if row.message.mission in verdicts else None
    return Mission.from_status(row.message, row.received_ns, state.alive("planner"), judged)


class Submissions:
    """Remembers which Idempotency-Key became which mission."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self._submitted: OrderedDict[str, tuple[NewMission, Mission]] = OrderedDict()
        self._submit_lock = threading.Lock()

    def submit(self, goal: NewMission, idempotency_key: str | None) -> Mission:
        """Hands a goal to the planner. The same key with the same goal is one mission, also across restarts."""
        if idempotency_key is None:
            return self._submit(f"m-{uuid.uuid4().hex[:12]}", goal)
        with self._submit_lock:  # two requests with one key must not both ask
            if known := self._submitted.get(idempotency_key):
                return _repeated(goal, known[0] == goal, known[1])
            id = "m-" + hashlib.sha256(f"{self._node.building}\0{idempotency_key}".encode()).hexdigest()[:16]
            if row := self._state.missions.newest("mission").get(id):  # a gateway before this one took it
                said = {canonical(row.message.target), canonical(row.message.asked)}
                return _repeated(goal, canonical(goal.target) in said, told(row, self._state))
            mission = self._submit(id, goal)
            self._submitted[idempotency_key] = goal, mission
            if len(self._submitted) > _REMEMBERED_KEYS:
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
        ack: MissionAck = ask(self._node, "planner", contract.MISSION_GOAL, message, mission=id).message
        if not ack.accepted:
            raise refusal(ack.error, ack.message)
        return Mission.from_ack(ack, goal, clock_ns())


def _repeated(goal: NewMission, same: bool, mission: Mission) -> Mission:
    if same:
        return mission
    raise Problem(
        422,
        "idempotency_key_reused",
        f"this Idempotency-Key belongs to mission {mission.id} for another goal ({mission.target!r}); "
        f"send a new key for {goal.target!r}",
    )
