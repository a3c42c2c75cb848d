"""Robots and perception workers; the routes ``/robots``, ``/robots/release``, ``/perception`` and ``/targets``."""

from __future__ import annotations

from contextlib import suppress

from fastapi import APIRouter

from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.messages import FINISHED_STATES, Halt, InferRequest
from surveilnav.rest import ROOT, Items, Robot, RobotHalt, Target, Worker
from surveilnav.services.gateway.bus_requests import absent, request
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import robot_from_status, worker_from_load
from surveilnav.services.gateway.responses import Limit, Offset, page_of
from surveilnav.services.gateway.state import BuildingState

#: A worker's answer to any word contains its whole vocabulary.
_PROBE_WORD = "chair"
_MAX_VOCABULARIES = 100


class Robots:
    """All robots that have ever published their status. Those that have left are stale."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node

    def all(self) -> list[Robot]:
        """Every robot, with its open mission."""
        alive, statuses = self._node.alive("robot"), self._state.robots
        missions = [row.message for row in self._state.missions.rows()]
        mission_of_robot = {m.robot: m.mission for m in missions if m.state not in FINISHED_STATES}
        frames = {f.robot: f for row in self._state.revisions.rows() for f in row.message.frames}
        return [
            robot_from_status(
                row.message,
                mission_of_robot.get(id),
                row.received_ns,
                id not in alive or statuses.is_old(row),
                frames.get(id),
            )
            for id, row in statuses.newest("robot").items()
        ]

    def halt(self, halted: bool, reason: str) -> list[RobotHalt]:
        """Stops all robots at once, or releases them, and returns what each answered.

        Robots that don't answer the request to all are asked again by name.

        Raises:
            Problem: there is no robot (503); the robots are those of a replay (409); a robot that is alive doesn't confirm (504,
                with all answers).
        """
        alive = self._node.alive("robot")
        message = Halt(stamp_ns=clock_ns(), halted=halted, reason=reason)
        answers = {
            r.ids["robot"]: r.message.halted for r in self._node.ask_all(contract.ROBOT_HALT, message, timeout_s=1.0)
        }
        for robot in sorted(alive - set(answers)):
            try:
                row = request(self._node, f"robot {robot}", contract.ROBOT_HALT, message, robot=robot)
                answers[robot] = row.message.halted
            except Problem as problem:
                if problem.status == 409:  # a robot of a recording; a real one never refuses
                    raise
        known = alive | set(answers) | set(self._state.robots.newest("robot"))
        halts = [RobotHalt(robot=robot, halted=answers.get(robot), stale=robot not in alive) for robot in sorted(known)]
        if not halts:
            raise absent("robot")
        if silent := [h.robot for h in halts if h.halted is not halted and not h.stale]:
            detail = f"{', '.join(silent)} didn't say that it {'stopped' if halted else 'is released'}: go there, or try again"
            raise Problem(504, "robot_silent", detail, robots=[h.model_dump() for h in halts])
        return halts


class PerceptionWorkers:
    """All perception workers that have ever published their load, and their vocabularies."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self._vocabularies: dict[tuple[str, str], list[str]] = {}

    def all(self) -> list[Worker]:
        """Every perception worker, with what it runs."""
        alive, loads = self._node.alive("perception"), self._state.loads
        return [
            worker_from_load(row.message, row.received_ns, id not in alive or loads.is_old(row))
            for id, row in loads.newest("worker").items()
        ]

    def targets(self) -> list[Target]:
        """The vocabularies of all ready workers. Workers with an open vocabulary, which understand any word, add none."""
        workers: dict[str, list[str]] = {}
        for worker in self.all():
            for name in self._vocabulary(worker) if worker.ready and not worker.stale else ():
                workers.setdefault(name, []).append(worker.id)
        return [Target(name=name, workers=ids) for name, ids in sorted(workers.items())]

    def _vocabulary(self, worker: Worker) -> list[str]:
        """A worker's vocabulary, which is cached until its detector changes. Empty if the worker doesn't answer."""
        key = worker.id, worker.models["detector"]
        if key not in self._vocabularies:
            message = InferRequest(stamp_ns=clock_ns(), texts=[_PROBE_WORD])
            with suppress(Problem):
                reply = request(
                    self._node, "perception", contract.PERCEPTION_TEXT, message, worker=worker.id, timeout_s=3.0
                )
                self._vocabularies = {
                    **dict(list(self._vocabularies.items())[-_MAX_VOCABULARIES:]),
                    key: reply.message.vocabulary,
                }
        return self._vocabularies.get(key, [])


def router(robots: Robots, workers: PerceptionWorkers) -> APIRouter:
    """The addresses of robots and perception workers."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/robots", name="robots")
    def list_robots(limit: Limit = 100, offset: Offset = 0) -> Items[Robot]:
        return page_of(robots.all(), limit, offset)

    @router.post("/robots/release")
    def release() -> Items[RobotHalt]:
        """Releases all robots. This moves none of them: their missions stay paused until each is resumed."""
        return page_of(robots.halt(False, ""))

    @router.get("/perception")
    def perception(limit: Limit = 100, offset: Offset = 0) -> Items[Worker]:
        """Perception workers, the backend that each runs, and why that one."""
        return page_of(workers.all(), limit, offset)

    @router.get("/targets")
    def targets(limit: Limit = 1000, offset: Offset = 0) -> Items[Target]:
        """Names of what can be searched for. A worker with an open vocabulary has none here: it understands any word."""
        return page_of(workers.targets(), limit, offset)

    return router
