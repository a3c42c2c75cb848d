"""The robot node: takes commands, has the body carry them out, publishes observations and status."""

from __future__ import annotations

import threading
import time

from surveilnav.bus import Answer, Node, Refused, Request, bound_request_id, clock_ns, request_id
from surveilnav.contract import ROBOT_COMMAND, ROBOT_HALT, ROBOT_STATUS
from surveilnav.messages import CommandReply, HaltReply, RobotStatus
from surveilnav.services.robot_node import core
from surveilnav.services.robot_node.bodies.body import Body
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.halt_switch import HaltSwitch
from surveilnav.services.robot_node.observation import encode
from surveilnav.services.robot_node.publishing import ObservationPublisher
from surveilnav.services.robot_node.verdicts import Judge, StopJudge

_STATUS_PERIOD_S = 1.0
_HALT_RETRY_S = 0.05


class RobotService:
    """Carries out one command at a time with its body, and publishes what the robot observes afterwards."""

    def __init__(self, node: Node, body: Body, settings: RobotSettings, judge: Judge | None = None) -> None:
        self._node, self._body, self._settings = node, body, settings
        #: Held while a command is carried out.
        self._acting = threading.Lock()
        self._unpublished = True
        self._status_s = 0.0
        self._deadline_s: float | None = None
        self._problem = self._request_id = ""  # of the last command
        self._halt_switch = HaltSwitch(settings.store)
        self._stop_judge = StopJudge(node, settings.id, judge) if judge is not None else None
        self._observations = ObservationPublisher(node, settings.id)
        self._statuses = node.publisher(ROBOT_STATUS, robot=settings.id)
        node.serve(ROBOT_COMMAND, self._on_command, robot=settings.id)
        node.serve(ROBOT_HALT, self._on_halt, robot=settings.id)
        node.serve(ROBOT_STATUS, lambda _: Answer(self._status()), robot=settings.id)

    def _on_command(self, request: Request) -> Answer:
        """Carries out a command, unless it was decided on another observation, the robot is halted, or can't do it."""
        command, body = request.message, self._body
        with self._acting:
            seq = body.state.seq
            if command.seq_expected != seq:
                error = f"expected sequence number {seq}, got {command.seq_expected}"
                return Answer(CommandReply(stamp_ns=clock_ns(), accepted=False, seq=seq, error=error))
            if reason := self._halt_switch.state.refusal(command.action):
                raise Refused("halted", reason)
            if reason := body.refusal(command.action, command.to_floor):
                raise Refused("bad_command", reason)
            if command.mission != body.state.mission:
                body.begin_mission(command.mission)
                self._node.log.info("begins a mission", mission=command.mission)
            body.act(command.action, command.to_floor)
            self._unpublished, self._problem, self._request_id = True, "", request_id()
            self._deadline_s = None if body.state.stopped else time.monotonic() + command.deadline_ms / 1000
            self._node.wake.set()
            if self._stop_judge is not None:
                self._stop_judge.judge_stop(body.state)
            return Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=body.state.seq))

    def _on_halt(self, request: Request) -> Answer:
        """Halts or releases the robot. When the answer to a halt goes out, the command in progress has ended."""
        halt = request.message
        self._halt_switch.set(halt.halted, halt.reason)
        if halt.halted:
            self._body.halt()
            # A command that passed the check just before may begin to move the robot only now: halt it, too.
            while not self._acting.acquire(timeout=_HALT_RETRY_S):
                self._body.halt()
            self._acting.release()
        self._node.log.warning("halted" if halt.halted else "released", reason=halt.reason)
        self._status_s = 0.0  # publish the status at once
        self._node.wake.set()
        return Answer(HaltReply(stamp_ns=clock_ns(), robot=self._settings.id, halted=halt.halted))

    def step(self) -> bool:
        """One turn of the loop: publishes what is due. True if a new observation was published."""
        with bound_request_id(self._request_id):
            return self._publish_due(time.monotonic())

    def _publish_due(self, now_s: float) -> bool:
        with self._acting:
            is_new, self._unpublished = self._unpublished, False
            self._check_deadline(now_s)
        if is_new or now_s - self._status_s >= _STATUS_PERIOD_S:
            self._status_s = now_s
            self._halt_switch.retry_saving()
            self._statuses.put(self._status())
        if is_new:
            observed, quality = self._body.observe(), self._settings.jpeg_quality
            self._observations.publish(encode(observed, self._settings.id, quality, stamp_ns=clock_ns()), now_s)
            return True
        self._observations.repeat_if_due(now_s)
        return False

    def _check_deadline(self, now_s: float) -> None:
        """Reports the robot as stopped, at once, if the deadline for the next command has passed."""
        if self._deadline_s is not None and now_s > self._deadline_s:
            self._deadline_s, self._problem = None, "stopped: no command came before the deadline"
            self._node.log.warning("no command before the deadline: holding still", seq=self._body.state.seq)
            self._status_s = 0.0

    def _status(self) -> RobotStatus:
        state = self._body.state  # read once: mission and path must belong together
        halt = self._halt_switch.state
        missed, awaiting = bool(self._problem), self._deadline_s is not None
        return core.status_message(
            state,
            robot=self._settings.id,
            state_name=core.reported_state(state, halt, deadline_missed=missed, awaiting_command=awaiting),
            message=halt.refusal("move") or self._problem,
            stairs=self._body.stairs,
            notes=[*self._body.notes, *self._halt_switch.notes],
            stamp_ns=clock_ns(),
        )
