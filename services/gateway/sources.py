"""What moves and what looks at pictures: robots and perception workers."""

from __future__ import annotations

from contextlib import suppress

from services.gateway.asking import absent, ask
from services.gateway.core.problems import Problem
from services.gateway.core.resources import Robot, RobotHalt, Worker
from services.gateway.state import BuildingState
from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.messages import FINISHED_STATES, Halt


class Sources:
    """All robots and workers that were ever heard of, those that left as stale."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node

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
            Problem: no robot is there (503), or one that is doesn't say that it obeyed (504, with all answers).
        """
        here = self._node.alive("robot")
        message = Halt(stamp_ns=clock_ns(), halted=halted, reason=reason)
        told = {
            r.ids["robot"]: r.message.halted for r in self._node.ask_all(contract.ROBOT_HALT, message, timeout_s=1.0)
        }
        for robot in sorted(here - set(told)):
            with suppress(Problem):
                told[robot] = ask(
                    self._node, f"robot {robot}", contract.ROBOT_HALT, message, robot=robot
                ).message.halted
        known = here | set(told) | set(self._state.robots.newest("robot"))
        answers = [RobotHalt(robot=robot, halted=told.get(robot), stale=robot not in here) for robot in sorted(known)]
        if not answers:
            raise absent("robot")
        if silent := [a.robot for a in answers if a.halted is not halted and not a.stale]:
            detail = f"{', '.join(silent)} didn't say that it {'stopped' if halted else 'is released'}: go there, or try again"
            raise Problem(504, "robot_silent", detail, robots=[a.model_dump() for a in answers])
        return answers

    def workers(self) -> list[Worker]:
        """Every perception worker, with what it runs."""
        alive, loads = self._node.alive("perception"), self._state.loads
        return [
            Worker.from_load(row.message, row.received_ns, id not in alive or loads.old(row))
            for id, row in loads.newest("worker").items()
        ]
