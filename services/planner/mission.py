"""One mission: the step-synchronous loop of one robot, on a thread of its own."""

from __future__ import annotations

import math
import threading
from typing import Any

import msgspec

from services.planner.config import PlannerSettings
from services.planner.core import Decision, MapView, MissionState, RobotView, step
from services.planner.world import CancelError, LostError, World, yaw_of_status
from surveilnav.contract import MISSION_PLAN, MISSION_STATUS
from surveilnav.messages import MissionGoal, MissionStatus, Plan, Revision, RobotStatus
from surveilnav.runtime import Node, Refused, Table, clock_ns

FINISHED = ("done", "failed", "cancelled")


class Mission:
    """A goal and what became of it. ``status`` and ``plan`` are the newest of their kind."""

    def __init__(
        self, node: Node, settings: PlannerSettings, revisions: Table[Revision], goal: MissionGoal, target: str,
        robot: str,
    ) -> None:  # fmt: skip
        self.robot = robot
        self._node, self._settings = node, settings
        self._memory = MissionState(target, max_steps=goal.max_steps)
        self._cancel: str | None = None
        self._ended = threading.Event()
        self._world = World(node, settings, revisions, robot, target, self._hold, lambda: self._cancel is not None)
        self._last_place: tuple[float, float] | None = None
        self._last_action: str | None = None
        self.plan: Plan | None = None
        self.status = MissionStatus(
            stamp_ns=clock_ns(), mission=goal.mission, target=target, robot=robot, state="queued", phase="queued",
            step=0, max_steps=goal.max_steps, path_m=0.0, started_ns=clock_ns(),
        )  # fmt: skip
        self._statuses = node.publisher(MISSION_STATUS, mission=goal.mission)
        self._plans = node.publisher(MISSION_PLAN, mission=goal.mission)
        self._thread = threading.Thread(target=self._run, name=f"mission-{goal.mission}", daemon=True)

    @property
    def id(self) -> str:
        return self.status.mission

    @property
    def finished(self) -> bool:
        return self.status.state in FINISHED

    def start(self) -> None:
        self._say()
        self._thread.start()

    def cancel(self, reason: str, wait_s: float) -> None:
        """Has the robot stop; waits a little for that to have happened."""
        self._cancel = reason or "cancelled"
        self._ended.wait(wait_s)

    # --- the loop -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._say(state="active", phase="waiting", message="waiting for the robot's first view in the maps")
            self._search()
        except CancelError:
            if self._node.stopping.is_set():
                return  # nobody hears us any more; the robot's own deadline stops it
            self._stop_robot()
            self._end("cancelled", message=self._cancel or "")
        except LostError as lost:
            self._stop_robot()
            self._end("failed", error=lost.name, message=str(lost))
        except Exception as error:  # a bug must end this mission only, and not in silence
            if self._node.stopping.is_set():
                return  # the session was closed under our feet
            self._node.log.exception("mission failed", mission=self.id)
            self._stop_robot()
            self._end("failed", error="internal", message=f"{type(error).__name__} in the planner; see its log")
        finally:
            self._ended.set()
            if not self._node.stopping.is_set():
                self._statuses.close()
                self._plans.close()

    def _search(self) -> None:
        """Maps that hold observation n -> decision -> action -> observation n + 1, until the mission ends."""
        while True:
            self._world.check_cancelled()
            status = self._world.robot_status()
            maps = self._world.maps_with(status.seq, wait_for_cameras=self._memory.step == 0)
            decision = self._decide(status, maps)
            if decision.finished:
                if self._concluded(decision, status.seq):
                    return
                self._memory.finished = False  # the robot stands elsewhere than we thought: look again
                continue
            self._world.check_cancelled()
            self._act(decision, status.seq)

    def _decide(self, status: RobotStatus, maps: MapView) -> Decision:
        x_m, y_m, _ = status.T_world_base.translation_m
        moved_m = math.dist((x_m, y_m), self._last_place) if self._last_place else 0.0
        self._last_place = x_m, y_m
        path_m = self.status.path_m + moved_m
        collided = self._last_action == "move_forward" and moved_m < 0.96 * self._settings.core.step_m
        robot = RobotView(
            status.seq, x_m, y_m, yaw_of_status(status), status.pitch_rad, status.floor, collided, self._last_action,
            path_m,
        )  # fmt: skip
        self._memory, decision = step(self._memory, maps, robot, self._settings.core)
        self._put_plan(decision, status)
        if not decision.finished:
            self._say(
                state="confirming" if decision.phase == "confirming" else "active", phase=decision.phase,
                step=self._memory.step, path_m=path_m, floor=status.floor, object_id=decision.object_id,
                distance_remaining_m=decision.distance_m, message=decision.message,
            )  # fmt: skip
        else:
            self._note(step=self._memory.step, path_m=path_m, floor=status.floor, object_id=decision.object_id)
        return decision

    def _act(self, decision: Decision, seq: int) -> None:
        action = str(decision.action)
        try:
            newest = self._world.move(action, seq, self.id, decision.to_floor)
        except Refused as refused:
            raise LostError("stuck", f"robot {self.robot} refused {action}: {refused}") from refused
        self._last_action = action if newest == seq + 1 else None

    def _concluded(self, decision: Decision, seq: int) -> bool:
        """Ends the mission as decided; False if the robot didn't carry out the stop that says "found"."""
        if not decision.found:
            self._stop_robot()
            self._end("failed", error=decision.error, message=decision.message)
            return True
        try:
            if self._world.move("stop", seq, self.id) != seq + 1:
                return False
        except Refused as refused:
            raise LostError("stuck", f"robot {self.robot} refused to stop: {refused}") from refused
        self._end("done", found=True, message=decision.message)
        return True

    def _stop_robot(self) -> None:
        """Tells the robot to stop, once and without insisting: its own deadline does the rest."""
        world = World(
            self._node, self._settings.model_copy(update={"robot_timeout_s": 1e-3}), self._world.revisions, self.robot,
            self._world.target, lambda _: None, lambda: False,
        )  # fmt: skip
        try:
            world.move("stop", world.robot_status().seq, self.id)
        except (LostError, Refused, CancelError) as error:
            self._node.log.warning("couldn't stop the robot", robot=self.robot, error=str(error))

    # --- saying so ------------------------------------------------------------------------------------------------

    def _hold(self, why: str) -> None:
        if self.status.message != why:
            self._say(phase="waiting", message=why)

    def _note(self, **changes: Any) -> None:
        self.status = msgspec.structs.replace(self.status, stamp_ns=clock_ns(), **changes)

    def _say(self, **changes: Any) -> None:
        self._note(**changes)
        self._statuses.put(self.status)

    def _end(self, state: str, *, error: str = "", message: str = "", found: bool = False) -> None:
        self._say(
            state=state, phase="finished", error=error, message=message, found=found, finished_ns=clock_ns(),
            distance_remaining_m=None,
        )  # fmt: skip
        self._node.log.info("mission ended", mission=self.id, state=state, error=error, message=message)

    def _put_plan(self, decision: Decision, status: RobotStatus) -> None:
        self.plan = Plan(
            stamp_ns=clock_ns(), mission=self.id, robot=self.robot, floor=status.floor, step=self._memory.step,
            seq=status.seq, action=decision.action or "", waypoint=decision.plan,
            path_m=[(round(x, 3), round(y, 3)) for x, y in decision.path], candidates=list(decision.candidates),
        )  # fmt: skip
        self._plans.put(self.plan)
