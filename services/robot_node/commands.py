"""Carries out what others command: one action at a time, a waypoint to drive to, or a halt."""

from __future__ import annotations

import threading
import time

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns, request_id
from surveilnav.contract import ROBOT_COMMAND, ROBOT_HALT
from surveilnav.messages import Command, CommandReply, HaltReply
from surveilnav.services.robot_node.bodies.body import Body
from surveilnav.services.robot_node.halt_switch import HaltSwitch
from surveilnav.services.robot_node.verdicts import StopJudge

_HALT_RETRY_S = 0.05


class CommandHandler:
    """Answers the commands to one robot. Thread-safe.

    Attributes:
        acting: held while a command is carried out.
        has_acted: whether an action was carried out whose observation isn't published yet.
        awaits_command: whether the deadline of the last command is still to come.
        problem: why the robot stands still, after the last command; empty if nothing is wrong.
        request_id: of the last command.
        must_report: whether the status changed by a command or a halt since somebody reset this.
    """

    def __init__(self, node: Node, robot: str, body: Body, halt_switch: HaltSwitch, judge: StopJudge | None) -> None:
        self._node, self._robot, self._body, self._halt_switch, self._judge = node, robot, body, halt_switch, judge
        self.acting = threading.Lock()
        self.has_acted, self.must_report = True, True
        self._deadline_s: float | None = None
        self.problem = self.request_id = ""
        node.serve(ROBOT_COMMAND, self._on_command, robot=robot)
        node.serve(ROBOT_HALT, self._on_halt, robot=robot)

    @property
    def awaits_command(self) -> bool:
        return self._deadline_s is not None

    def _on_command(self, request: Request) -> Answer:
        """Carries out a command, unless it was decided on another observation, the robot is halted, or can't do it."""
        command, body = request.message, self._body
        with self.acting:
            seq = body.state.seq
            if not self._is_expected(command, seq):
                error = f"expected sequence number {seq}, got {command.seq_expected}"
                return Answer(CommandReply(stamp_ns=clock_ns(), accepted=False, seq=seq, error=error))
            self._refuse_if_impossible(command)
            if command.mission != body.state.mission:
                body.begin_mission(command.mission)
                self._node.log.info("begins a mission", mission=command.mission)
            if command.action == "drive_to":
                body.drive_to(command.waypoint)
            else:
                body.act(command.action, command.to_floor)
                self.has_acted = True
            self.problem, self.request_id, self.must_report = "", request_id(), True
            self._deadline_s = None if body.state.stopped else time.monotonic() + command.deadline_ms / 1000
            self._node.wake.set()
            if self._judge is not None and command.found:
                self._judge.judge_stop(body.state)
            return Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=body.state.seq))

    def _is_expected(self, command: Command, seq: int) -> bool:
        """Whether it was decided on the newest observation or, if the robot observes while it drives, on an older one."""
        observes_meanwhile = self._body.description.drive == "waypoints"
        return command.seq_expected <= seq if observes_meanwhile else command.seq_expected == seq

    def _refuse_if_impossible(self, command: Command) -> None:
        """Raises Refused: the robot is halted, isn't ready, or can't do this at all."""
        if reason := self._halt_switch.state.refusal(command.action):
            raise Refused("halted", reason)
        if self._body.problem and command.action != "stop":
            raise Refused("not_ready", self._body.problem)
        if reason := self._body.refusal(command.action, command.to_floor):
            raise Refused("bad_command", reason)

    def _on_halt(self, request: Request) -> Answer:
        """Halts or releases the robot. When the answer to a halt goes out, the command in progress has ended."""
        halt = request.message
        self._halt_switch.set(halt.halted, halt.reason)
        if halt.halted:
            self._body.halt()
            # A command that passed the check just before may begin to move the robot only now: halt it, too.
            while not self.acting.acquire(timeout=_HALT_RETRY_S):
                self._body.halt()
            self.acting.release()
        self._node.log.warning("halted" if halt.halted else "released", reason=halt.reason)
        self.must_report = True
        self._node.wake.set()
        return Answer(HaltReply(stamp_ns=clock_ns(), robot=self._robot, halted=halt.halted))

    def check_deadline(self, now_s: float) -> None:
        """Stops the robot, and has it say so at once, if the deadline for the next command has passed."""
        if self._deadline_s is not None and now_s > self._deadline_s:
            self._deadline_s, self.problem, self.must_report = (
                None,
                "stopped: no command came before the deadline",
                True,
            )
            self._body.halt()
            self._node.log.warning("no command before the deadline: holding still", seq=self._body.state.seq)
