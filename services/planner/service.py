"""The planner service: takes missions, gives each a robot and a thread, tells what becomes of them.

With a store it takes up again, when it starts, what it was killed over.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from services.planner.config import PlannerSettings
from services.planner.mission import Mission, Surroundings, accepted
from services.planner.store import Store, StoreError
from services.planner.summaries import Summaries
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.categories import closed_set_target
from surveilnav.contract import MAP_REVISION, MISSION_CANCEL, MISSION_GOAL, MISSION_PLAN, MISSION_STATUS, ROBOT_STATUS
from surveilnav.errors import MissionError, TargetError
from surveilnav.messages import MissionAck, MissionCancel, MissionGoal

_CANCEL_WAIT_S = 3.0
_KEEP_AGAIN_S = 2.0


class PlannerService:
    """All missions of a building: one per robot at a time, several robots at once."""

    def __init__(self, node: Node, settings: PlannerSettings) -> None:
        self._node, self._settings = node, settings
        self._lock = threading.Lock()
        self._missions: dict[str, Mission] = {}
        for kind in ("robot", "fusion", "perception"):
            node.alive(kind)  # the first call starts watching
        self._robots = node.table(ROBOT_STATUS)
        self._store = Store(settings.store, node)
        self._around = Surroundings(node, settings, node.table(MAP_REVISION), Summaries(node), self._store)
        self._resumed = self._resume()
        self._kept_s = time.monotonic()
        node.serve(MISSION_GOAL, self._on_goal)
        node.serve(MISSION_CANCEL, self._on_cancel, workers=2)
        node.serve(MISSION_STATUS, lambda request: self._tell(request, _status_of))
        node.serve(MISSION_PLAN, lambda request: self._tell(request, _plan_of))

    def step(self) -> bool:
        """Missions run on threads of their own; here what the store couldn't do is tried again now and then."""
        now_s = time.monotonic()
        if now_s - self._kept_s >= _KEEP_AGAIN_S:
            self._kept_s = now_s
            with self._lock:
                self._resumed = self._resumed or self._resume()
                missions = list(self._missions.values())
            for mission in missions:
                mission.save_again()
        return False

    def _resume(self) -> bool:
        """Takes up the unfinished missions of the store, and knows the finished ones again; False if it can't be read.

        A robot has one mission: the last one accepted goes on, others that were left open end.
        """
        try:
            saved = self._store.load()
        except StoreError as error:
            self._node.warn_seldom("store_failed: no mission is resumed yet", error=str(error))
            return False
        self._missions = {s.status.mission: Mission(self._around, s) for s in saved}
        last = {m.robot: m for m in self._missions.values() if not m.finished}
        for mission in list(self._missions.values()):
            if mission.finished:
                continue
            if mission is not last[mission.robot]:
                mission.supersede(last[mission.robot].id)
                continue
            self._node.log.info("resumes a mission", mission=mission.id, step=mission.status.step)
            mission.start()
        self._forget_oldest()
        return True

    # --- goals and cancels ----------------------------------------------------------------------------------------

    def _on_goal(self, request: Request) -> Answer:
        goal: MissionGoal = request.message
        try:
            mission = self._accept(goal, request.ids["mission"])
        except MissionError as error:
            return Answer(
                MissionAck(
                    stamp_ns=clock_ns(), mission=goal.mission, accepted=False, state="failed", error=error.name,
                    message=str(error),
                )
            )  # fmt: skip
        state = mission.status.state
        return Answer(
            MissionAck(stamp_ns=clock_ns(), mission=mission.id, accepted=True, state=state, robot=mission.robot)
        )

    def _accept(self, goal: MissionGoal, id: str) -> Mission:
        """Starts a mission. MissionError: it can't be accepted, and what would be."""
        if goal.mission != id:
            raise MissionError("bad_goal", f"the key names mission {id!r}, the goal {goal.mission!r}: they must agree")
        if not 1 <= goal.max_steps <= self._settings.max_steps:
            raise MissionError("bad_goal", f"max_steps must be 1 to {self._settings.max_steps}, got {goal.max_steps}")
        try:
            target = closed_set_target(goal.target[:200])
        except TargetError as error:
            raise MissionError("bad_target", str(error)) from error
        with self._lock:
            if not self._resumed:  # a robot may have a mission already
                raise MissionError("store_failed", "the store of missions can't be read yet: send the goal again later")
            if known := self._missions.get(id):
                if (known.status.target, known.status.max_steps) == (target, goal.max_steps):
                    return known  # the same goal sent again
                raise MissionError("mission_exists", f"mission {id!r} exists already for {known.status.target!r}")
            robot = self._free_robot(goal.robot)
            mission = Mission(self._around, accepted(goal, target, robot))
            try:
                mission.save()  # before it is acknowledged: what was accepted exists, come what may
            except StoreError as error:
                raise MissionError("store_failed", str(error)) from error
            self._missions[id] = mission
            self._forget_oldest()
            mission.start()
        self._node.log.info("mission accepted", mission=id, target=target, robot=robot)
        return mission

    def _free_robot(self, wanted: str) -> str:
        """The robot asked for, or any that is here and has no mission."""
        here = sorted(self._node.alive("robot") & {row.message.robot for row in self._robots.rows()})
        busy = {m.robot: m.id for m in self._missions.values() if not m.finished}
        if wanted:
            if wanted not in here:
                known = ", ".join(here) or "none"
                raise MissionError("unknown_robot", f"no robot {wanted!r} is on the bus; here are: {known}")
            if wanted in busy:
                raise MissionError(
                    "robot_busy", f"robot {wanted!r} is on mission {busy[wanted]!r}: cancel that or wait for its end"
                )
            return wanted
        free = [robot for robot in here if robot not in busy]
        if not here:
            raise MissionError("no_free_robot", "no robot is on the bus: start a robot node and send the goal again")
        if not free:
            held = ", ".join(f"{robot} on {busy[robot]}" for robot in here)
            raise MissionError("no_free_robot", f"every robot has a mission ({held}): cancel one or wait for its end")
        return free[0]

    def _forget_oldest(self) -> None:
        finished = [id for id, m in self._missions.items() if m.finished]
        oldest = finished[: max(0, len(finished) - self._settings.finished_missions_kept)]
        for id in oldest:
            del self._missions[id]
        try:
            self._store.forget(oldest)
        except StoreError as error:
            self._node.warn_seldom("store_failed: old missions stay in it", error=str(error))

    def _on_cancel(self, request: Request) -> Answer:
        cancel: MissionCancel = request.message
        mission = self._missions.get(request.ids["mission"])
        if mission is None:
            ack = MissionAck(
                stamp_ns=clock_ns(), mission=cancel.mission, accepted=False, state="failed", error="unknown_mission",
                message=f"no mission {request.ids['mission']!r} is known here",
            )  # fmt: skip
            return Answer(ack)
        running = not mission.finished
        if running:
            mission.cancel(cancel.reason, _CANCEL_WAIT_S)
        return Answer(
            MissionAck(
                stamp_ns=clock_ns(), mission=mission.id, accepted=running, state=mission.status.state,
                robot=mission.robot, message="" if running else f"it is {mission.status.state} already",
            )
        )  # fmt: skip

    # --- telling --------------------------------------------------------------------------------------------------

    def _tell(self, request: Request, what: Callable[[Mission], Answer | None]) -> list[Answer]:
        """One mission's answer, or that of all for a wildcard."""
        id = request.ids.get("mission", "*")
        with self._lock:
            missions = list(self._missions.values())
        if "*" in id:
            return [answer for m in missions if (answer := what(m)) is not None]
        mission = next((m for m in missions if m.id == id), None)
        if mission is None:
            raise Refused("unknown_mission", f"no mission {id!r} is known here")
        answer = what(mission)
        if answer is None:
            raise Refused("no_plan", f"mission {id!r} has no plan yet")
        return [answer]


def _status_of(mission: Mission) -> Answer | None:
    return Answer(mission.status, ids={"mission": mission.id})


def _plan_of(mission: Mission) -> Answer | None:
    return None if mission.plan is None else Answer(mission.plan, ids={"mission": mission.id})
