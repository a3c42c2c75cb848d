"""What moves and what looks at pictures: robots and perception workers."""

from __future__ import annotations

from contextlib import suppress

from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.messages import FINISHED_STATES, Halt, InferRequest
from surveilnav.services.gateway.asking import absent, ask
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import Robot, RobotHalt, Target, Worker
from surveilnav.services.gateway.state import BuildingState

#: Any word: the answer tells all that a worker has.
_A_WORD = "chair"
_MOST_VOCABULARIES = 100


class Sources:
    """All robots and workers that were ever heard of, those that left as stale."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self._vocabularies: dict[tuple[str, str], list[str]] = {}

    def robots(self) -> list[Robot]:
        """Every robot, with the mission under way that it belongs to."""
        alive, statuses = self._node.alive("robot"), self._state.robots
        missions = [row.message for row in self._state.missions.rows()]
        busy = {m.robot: m.mission for m in missions if m.state not in FINISHED_STATES}
        return [
            Robot.from_status(row.message, busy.get(id), row.received_ns, id not in alive or statuses.old(row))
            for id, row in statuses.newest("robot").items()
        ]

    def halt(self, halted: bool, reason: str) -> list[RobotHalt]:
        """Stops all robots at once, or releases them; what each answered. Those that don't are asked again by name.

        Raises:
            Problem: no robot is there (503), it is one of a recording (409), or one that is there doesn't say that it obeyed
                (504, with all answers).
        """
        here = self._node.alive("robot")
        message = Halt(stamp_ns=clock_ns(), halted=halted, reason=reason)
        told = {
            r.ids["robot"]: r.message.halted for r in self._node.ask_all(contract.ROBOT_HALT, message, timeout_s=1.0)
        }
        for robot in sorted(here - set(told)):
            try:
                row = ask(self._node, f"robot {robot}", contract.ROBOT_HALT, message, robot=robot)
                told[robot] = row.message.halted
            except Problem as problem:
                if problem.status == 409:  # a robot of a recording; one that is there never refuses
                    raise
        known = here | set(told) | set(self._state.robots.newest("robot"))
        answers = [RobotHalt(robot=robot, halted=told.get(robot), stale=robot not in here) for robot in sorted(known)]
        if not answers:
            raise absent("robot")
        if silent := [a.robot for a in answers if a.halted is not halted and not a.stale]:
            detail = f"{', '.join(silent)} didn't say that it {'stopped' if halted else 'is released'}: go there, or try again"
            raise Problem(504, "robot_silent", detail, robots=[a.model_dump() for a in answers])
        return answers

    def targets(self) -> list[Target]:
        """The names of what can be searched for, of all workers that are ready; none of those that know any word."""
        workers: dict[str, list[str]] = {}
        for worker in self.workers():
            for name in self._vocabulary(worker) if worker.ready and not worker.stale else ():
                workers.setdefault(name, []).append(worker.id)
        return [Target(name=name, workers=ids) for name, ids in sorted(workers.items())]

    def _vocabulary(self, worker: Worker) -> list[str]:
        """A worker's names, asked once for as long as it runs the same; none if it doesn't tell now."""
        key = worker.id, worker.models["detector"]
        if key not in self._vocabularies:
            request = InferRequest(stamp_ns=clock_ns(), texts=[_A_WORD])
            with suppress(Problem):
                reply = ask(
                    self._node, "perception", contract.PERCEPTION_TEXT, request, worker=worker.id, timeout_s=3.0
                )
                self._vocabularies = {
                    **dict(list(self._vocabularies.items())[-_MOST_VOCABULARIES:]),
                    key: reply.message.vocabulary,
                }
        return self._vocabularies.get(key, [])

    def workers(self) -> list[Worker]:
        """Every perception worker, with what it runs."""
        alive, loads = self._node.alive("perception"), self._state.loads
        return [
            Worker.from_load(row.message, row.received_ns, id not in alive or loads.old(row))
            for id, row in loads.newest("worker").items()
        ]
