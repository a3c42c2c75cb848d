"""The robot node: commands in, a body that carries them out, observations out."""

from __future__ import annotations

import threading
import time

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import ROBOT_COMMAND, ROBOT_HALT, ROBOT_OBSERVATION, ROBOT_STATUS, TRUTH
from surveilnav.messages import CommandReply, HaltReply, RobotStatus
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.robot_node import core
from surveilnav.services.robot_node.bodies.body import Body
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.halting import Halting
from surveilnav.services.robot_node.observation import Encoded, encode
from surveilnav.services.robot_node.verdicts import Judge, Verdicts

#: An observation that nobody follows up is put again, ever more seldom: the router may have lost it.
_REPEAT_S = (1.0, 2.0, 4.0, 8.0)
_HALT_AGAIN_S = 0.05


class RobotService:
    """Has its body carry out one command at a time and publishes what it sees then."""

    def __init__(self, node: Node, body: Body, settings: RobotSettings, judge: Judge | None = None) -> None:
        self._node, self._body, self._settings = node, body, settings
        self._lock = threading.Lock()
        self._unpublished = True
        self._repeats = 0
        self._deadline_s: float | None = None
        self._published_s = self._status_s = 0.0
        self._message = ""
        self._halting = Halting(settings.store)
        self._latest: Encoded | None = None
        self._verdicts = Verdicts(node, settings.id, judge)
        self._observation = node.publisher(ROBOT_OBSERVATION, robot=settings.id)
        self._status = node.publisher(ROBOT_STATUS, robot=settings.id)
        self._truth = node.publisher(TRUTH, source=f"robot-{settings.id}", view=0)
        node.serve(ROBOT_COMMAND, self._on_command, robot=settings.id)
        node.serve(ROBOT_HALT, self._on_halt, robot=settings.id)
        node.serve(ROBOT_STATUS, lambda _: Answer(self._status_message()), robot=settings.id)

    def _on_command(self, request: Request) -> Answer:
        command, body = request.message, self._body
        with self._lock:
            seq = body.state.seq
            if command.seq_expected != seq:
                why = f"expected sequence number {seq}, got {command.seq_expected}"
                return Answer(CommandReply(stamp_ns=clock_ns(), accepted=False, seq=seq, error=why))
            if reason := self._halting.now.refusal(command.action):
                raise Refused("halted", reason)
            if reason := body.refusal(command.action, command.to_floor):
                raise Refused("bad_command", reason)
            if command.mission != body.state.mission:
                body.begin_mission(command.mission)
            body.act(command.action, command.to_floor)
            self._unpublished, self._repeats, self._message = True, 0, ""
            self._deadline_s = None if body.state.stopped else time.monotonic() + command.deadline_ms / 1000
            self._node.wake.set()
            self._verdicts.acted(body.state)
            return Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=body.state.seq))

    def _on_halt(self, request: Request) -> Answer:
        """Has the body end the command that it carries out; the answer says that it did."""
        halt = request.message
        self._halting.set(halt.halted, halt.reason)
        if halt.halted:
            self._body.halt()
            while not self._lock.acquire(timeout=_HALT_AGAIN_S):  # a command may have slipped in just before
                self._body.halt()
            self._lock.release()
        self._node.log.warning("halted" if halt.halted else "released", reason=halt.reason)
        self._status_s = 0.0  # tell at once
        self._node.wake.set()
        return Answer(HaltReply(stamp_ns=clock_ns(), robot=self._settings.id, halted=halt.halted))

    def step(self) -> bool:
        """One turn of the loop; True if there was something to do."""
        now_s = time.monotonic()
        with self._lock:
            fresh, self._unpublished = self._unpublished, False
            self._hold_if_late(now_s)
        if now_s - self._status_s >= 1.0 or fresh:
            self._status_s = now_s
            self._status.put(self._status_message())
        if fresh:
            self._latest = encode(self._body.observe(), self._settings.id, self._settings.jpeg_quality)
            self._put(self._latest, now_s)
            return True
        wait_s = _REPEAT_S[min(self._repeats, len(_REPEAT_S) - 1)]
        if self._latest and now_s - self._published_s >= wait_s and self._observation.matched:
            self._repeats += 1
            self._put(self._latest, now_s)
        return False

    def _hold_if_late(self, now_s: float) -> None:
        """Without a command before the deadline the robot counts as stopped, and says so at once."""
        if self._deadline_s is not None and now_s > self._deadline_s:
            self._deadline_s, self._message = None, "stopped: no command came before the deadline"
            self._node.log.warning("no command before the deadline: holding still", seq=self._body.state.seq)
            self._status_s = 0.0

    def _put(self, latest: Encoded, now_s: float) -> None:
        self._published_s = now_s
        seen = latest.observation
        if latest.truth is not None and self._truth.matched:  # only the backends oracle and simulated ever listen
            truth = truth_to_wire(latest.truth, source=seen.source, view=seen.view, seq=seen.seq, stamp_ns=clock_ns())
            self._truth.put(*truth)
        self._observation.put(seen, latest.payload)

    def _status_message(self) -> RobotStatus:
        state = self._body.state  # once: a mission and its way begin together
        late, awaiting = bool(self._message), self._deadline_s is not None
        kind = core.state_name(state, self._halting.now, late=late, awaiting=awaiting)
        return core.status_of(
            state,
            robot=self._settings.id,
            kind=kind,
            message=self._halting.now.refusal("move") or self._message,
            stairs=self._body.stairs,
            notes=self._body.notes,
            stamp_ns=clock_ns(),
        )
