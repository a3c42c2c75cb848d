"""Keeps all missions of a building: accepts goals, assigns robots to them, and resumes missions after a restart."""

from __future__ import annotations

import threading
from pathlib import Path

from surveilnav.bus import Node, bound_request_id
from surveilnav.contract import MAP_REVISION, ROBOT_STATUS
from surveilnav.errors import MissionError
from surveilnav.messages import MissionGoal
from surveilnav.services.planner.area_announcer import AreaAnnouncer
from surveilnav.services.planner.areas import BuildingAreas
from surveilnav.services.planner.config import PlannerSettings
from surveilnav.services.planner.mission_runner import MissionRunner
from surveilnav.services.planner.mission_start import MissionContext, lost_mission, new_mission
from surveilnav.services.planner.store import Store, StoreError
from surveilnav.services.planner.summaries import Summaries
from surveilnav.services.planner.targets import resolve_target


class MissionRegistry:
    """One mission per robot at a time, several robots at once. Safe to use from any thread."""

    def __init__(self, node: Node, settings: PlannerSettings) -> None:
        self._node, self._settings = node, settings
        self._lock = threading.Lock()
        self._missions: dict[str, MissionRunner] = {}
        self._lost: set[str] = set()  # that ``end_lost`` has ended
        self._robots = node.table(ROBOT_STATUS)
        self._store = Store(settings.store, node)
        self._areas = BuildingAreas(node, Path(settings.building_file) if settings.building_file else None)
        self._announcer = AreaAnnouncer(node, self._areas)
        self._context = MissionContext(
            node, settings, node.table(MAP_REVISION), Summaries(node), self._store, self._areas
        )
        self._resumed = self._resume()

    def all(self) -> list[MissionRunner]:
        """All missions, in the order in which they were accepted."""
        with self._lock:
            return list(self._missions.values())

    def get(self, id: str) -> MissionRunner | None:
        """The mission of that id; None if it isn't known."""
        with self._lock:
            return self._missions.get(id)

    def retry_saving(self) -> None:
        """Tries again what failed: reading the store when the planner started, or writing the end of a mission."""
        with self._lock:
            self._resumed = self._resumed or self._resume()
        for mission in self.all():
            mission.retry_saving()
        self._store.retry()
        self._node.report_problem("store", self._store.problem)

    def refresh_areas(self) -> None:
        """Reads the building file again if it has changed, and tells others of areas that have changed."""
        self._areas.refresh()
        self._announcer.publish()

    def accept(self, goal: MissionGoal) -> MissionRunner:
        """Starts a mission, or returns the one that the same goal started before.

        Raises:
            MissionError: it can't be accepted; the message says what would be.
        """
        if not 1 <= goal.max_steps <= self._settings.max_steps:
            raise MissionError("bad_goal", f"max_steps must be 1 to {self._settings.max_steps}, got {goal.max_steps}")
        target = resolve_target(self._node, goal.target)
        with self._lock:
            if not self._resumed:  # a robot may have a mission already
                raise MissionError("store_failed", "the store of missions can't be read yet: send the goal again later")
            if known := self._missions.get(goal.mission):
                if known.matches(goal, target):
                    return known  # the same goal sent again
                raise MissionError("mission_exists", f"mission {known.id!r} exists already for {known.status.target!r}")
            mission = self._begin(goal, target)
        self._node.log.info("mission accepted", mission=mission.id, target=target, robot=mission.robot)
        return mission

    def _begin(self, goal: MissionGoal, target: str) -> MissionRunner:
        robot, why = self._robot_for(goal)
        mission = MissionRunner(self._context, new_mission(goal, target, robot, why))
        try:
            mission.save()  # before it is acknowledged: what was accepted exists, come what may
        except StoreError as error:
            raise MissionError("store_failed", str(error)) from error
        self._missions[mission.id] = mission
        self._forget_oldest()
        mission.announce()
        return mission

    def _robot_for(self, goal: MissionGoal) -> tuple[str, str]:
        """Returns (robot, "") for a goal, or ("", why the mission has to wait). MissionError: the goal can't be accepted."""
        try:
            return self._free_robot(goal.robot), ""
        except MissionError as error:
            if not goal.queue or error.name == "unknown_robot":
                raise
            waiting = sum(m.is_queued for m in self._missions.values())
            if waiting >= self._settings.max_queued:
                raise MissionError("queue_full", f"{waiting} missions wait for a robot already: cancel one") from error
            return "", f"waits: {str(error).partition(':')[0]}"  # the rest of the message suggests queueing

    def assign_robots(self) -> None:
        """Starts queued missions for which a robot is free now, in the order in which they were accepted."""
        with self._lock:
            for mission in [m for m in self._missions.values() if m.is_queued]:
                try:
                    mission.assign(self._free_robot(mission.wanted_robot))
                except (MissionError, StoreError):
                    continue

    def end_lost(self) -> None:
        """Ends missions that robots are on and of which the store knows nothing any more, so that nobody waits for them."""
        with self._lock:
            for status in [row.message for row in self._robots.rows()] if self._resumed else []:
                under_way = (
                    status.mission and status.last_action != "stop" and status.robot in self._node.alive("robot")
                )
                if not under_way or status.mission in self._missions or status.mission in self._lost:
                    continue
                self._lost.add(status.mission)
                mission = self._missions[status.mission] = MissionRunner(self._context, lost_mission(status))
                mission.end_lost()
                self._node.log.error("a mission was lost with the store", mission=mission.id, robot=status.robot)

    def is_halted(self, robot: str) -> bool:
        """Whether a robot's latest status says that it is halted."""
        return any(row.message.robot == robot and row.message.state == "halted" for row in self._robots.rows())

    def _battery_is_low(self, robot: str) -> str:
        """Why a robot's battery doesn't suffice for another mission, by its latest status; empty if it does, or isn't known."""
        shares = (row.message.battery for row in self._robots.rows() if row.message.robot == robot)
        share, least = next(shares, None), self._settings.min_battery
        is_low = share is not None and 0.0 <= share < least
        return "" if share is None or not is_low else f"its battery is at {share:.0%}, and {least:.0%} are needed"

    def _resume(self) -> bool:
        """Resumes the unfinished missions of the store and loads the finished ones; False if the store can't be read.

        A robot has one mission at a time: the one accepted last goes on, other open ones of the same robot end.
        """
        try:
            saved = self._store.load()
        except StoreError as error:
            self._node.warn_seldom("store_failed: no mission is resumed yet", error=str(error))
            return False
        self._missions = {s.status.mission: MissionRunner(self._context, s) for s in saved}
        last = {m.robot: m for m in self._missions.values() if not m.finished and m.robot}
        for mission in list(self._missions.values()):
            if mission.finished:
                continue
            if mission.robot and mission is not last[mission.robot]:
                mission.supersede(last[mission.robot].id)
                continue
            with bound_request_id(mission.status.request_id):
                self._node.log.info("resumes a mission", mission=mission.id, step=mission.status.step)
                mission.announce()
        self._forget_oldest()
        return True

    def _free_robot(self, wanted: str) -> str:
        """A free robot: the wanted one or, with "", any. MissionError: there is none; the message says why."""
        here = sorted(self._node.alive("robot") & {row.message.robot for row in self._robots.rows()})
        busy = {m.robot: m.id for m in self._missions.values() if not m.finished and m.robot}
        if wanted:
            if wanted not in here:
                known = ", ".join(here) or "none"
                raise MissionError("unknown_robot", f"no robot {wanted!r} is on the bus; here are: {known}")
            if wanted in busy:
                raise MissionError(
                    "robot_busy", f"robot {wanted!r} is on mission {busy[wanted]!r}: cancel that or wait for its end"
                )
            if self.is_halted(wanted):
                raise MissionError("robot_halted", f"robot {wanted!r} is halted: release it first")
            if why := self._battery_is_low(wanted):
                raise MissionError("robot_battery", f"robot {wanted!r} has to charge first: {why}")
            return wanted
        unfit = {robot: "halted" if self.is_halted(robot) else self._battery_is_low(robot) for robot in here}
        free = [robot for robot in here if robot not in busy and not unfit[robot]]
        if not here:
            raise MissionError("no_free_robot", "no robot is on the bus: start a robot node and send the goal again")
        if not free:
            held = ", ".join(f"{robot} {'on ' + busy[robot] if robot in busy else unfit[robot]}" for robot in here)
            raise MissionError(
                "no_free_robot",
                f"no robot is free ({held}): cancel a mission, release a robot, wait, or queue the goal",
            )
        return free[0]

    def _forget_oldest(self) -> None:
        finished = [id for id, m in self._missions.items() if m.finished]
        oldest = finished[: max(0, len(finished) - self._settings.finished_missions_kept)]
        for id in oldest:
            del self._missions[id]
        try:
            self._store.delete(oldest)
        except StoreError as error:
            self._node.warn_seldom("store_failed: old missions stay in it", error=str(error))
