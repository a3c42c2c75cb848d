"""Missions: followed, paused, cancelled."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from surveilnav import contract
from surveilnav.bus import Received, clock_ns
from surveilnav.errors import SurveilNavError
from surveilnav.messages import FINISHED_STATES, MissionAck, MissionCancel, MissionPause, MissionStatus
from surveilnav.services.gateway.asking import ask, ask_known
from surveilnav.services.gateway.core.cursors import Place, page_after
from surveilnav.services.gateway.core.problems import Problem, refusal
from surveilnav.services.gateway.core.resources import GrowingItems, Mission, MissionPlan, NewMission
from surveilnav.services.gateway.state import BuildingState
from surveilnav.services.gateway.submissions import Submissions, told

_AT_ONCE = 16


class Missions:
    """All missions of the building, whoever submitted them."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node, self.root = state, state.node, state.root
        self._submissions = Submissions(state)

    def submit(self, goal: NewMission, idempotency_key: str | None) -> Mission:
        """Hands a goal to the planner. The same key with the same goal is one mission, also across restarts."""
        return self._submissions.submit(goal, idempotency_key)

    def all(self) -> list[Mission]:
        """Newest first."""
        verdicts = self._state.judged.newest("mission")
        return [told(row, self._state, verdicts) for row in self._rows()]

    def page(self, cursor: str | None, offset: int, limit: int) -> GrowingItems[Mission]:
        """At most ``limit``, newest first, after a cursor or from ``offset``."""
        rows = self._rows()
        page, next_cursor = page_after(rows, _place, cursor, offset, limit)
        verdicts = self._state.judged.newest("mission")
        items = [told(row, self._state, verdicts) for row in page]
        return GrowingItems(items=items, total=len(rows), next=next_cursor)

    def _rows(self) -> list[Received[MissionStatus]]:
        return sorted(self._state.missions.newest("mission").values(), key=_place)

    def get(self, id: str) -> Mission:
        """The mission as it was last told of, or as the planner tells when asked."""
        row = self._state.missions.newest("mission").get(id)
        if row is None:  # accepted a moment ago, or before this gateway was there
            row = ask_known(self._node, "mission", id, "planner", contract.MISSION_STATUS, mission=id)
        return self._told(row)

    def cancel(self, id: str, reason: str) -> Mission:
        """Asks the planner to end a mission; one that is finished can't be cancelled (409)."""
        message = MissionCancel(stamp_ns=clock_ns(), mission=id, reason=reason)
        return self._done(id, ask(self._node, "planner", contract.MISSION_CANCEL, message, mission=id).message)

    def pause(self, id: str, reason: str, *, paused: bool) -> Mission:
        """Pauses a mission, or has it go on; one that is finished does neither (409)."""
        message = MissionPause(stamp_ns=clock_ns(), mission=id, paused=paused, reason=reason)
        return self._done(id, ask(self._node, "planner", contract.MISSION_PAUSE, message, mission=id).message)

    def pause_all(self, reason: str) -> None:
        """Pauses what is under way, all at once; what can't be paused now is left: robots that are halted don't move."""

        def pause(id: str) -> None:
            with suppress(Problem, SurveilNavError):
                self.pause(id, reason, paused=True)

        under_way = [m.id for m in self.all() if m.state not in FINISHED_STATES]
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(pause, under_way))

    def _done(self, id: str, ack: MissionAck) -> Mission:
        """The mission in the state that the planner says it came to."""
        if not ack.accepted:
            if ack.state in FINISHED_STATES and not ack.error:
                raise Problem(409, "finished", f"mission {id} is {ack.state} already; submit a new one")
            raise refusal(ack.error, ack.message)
        return self.get(id).model_copy(update={"state": ack.state})

    def plans(self) -> list[MissionPlan]:
        """The present plans of the missions under way."""
        alive = self._state.alive("planner")
        under_way = {
            id for id, row in self._state.missions.newest("mission").items() if row.message.state not in FINISHED_STATES
        }
        rows = self._state.plans.newest("mission").items()
        return [MissionPlan.from_plan(row.message, row.received_ns, alive) for id, row in rows if id in under_way]

    def plan(self, id: str) -> MissionPlan:
        """The planner's present plan for a mission."""
        row = ask_known(self._node, "plan of mission", id, "planner", contract.MISSION_PLAN, mission=id)
        return MissionPlan.from_plan(row.message, row.received_ns, self._state.alive("planner"))

    def _told(self, row: Received[MissionStatus]) -> Mission:
        return told(row, self._state)


def _place(row: Received[MissionStatus]) -> Place:
    """Newest first."""
    return -max(0, row.message.started_ns), row.ids["mission"]
