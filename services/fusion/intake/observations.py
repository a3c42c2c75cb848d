"""Observations of robots, as they are published; and those that got lost, which are asked for.

A robot publishes each observation once. Its status says which one is the newest, so whoever lacks it knows that, and asks: a full
link may have dropped it, or fusion began to listen later.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from surveilnav.bus import LatestMessage, Node, Received, bound_request_id
from surveilnav.contract import ROBOT_OBSERVATION
from surveilnav.errors import BusError
from surveilnav.messages import FrameHeader, RobotStatus

#: An observation is asked for so long after its robot's status told of it, and again after twice that time, up to the second.
_PATIENCE_S, _MAX_PATIENCE_S = 1.5, 30.0
#: So long an answer may take on a slow link.
_ANSWER_S = 20.0


@dataclass(slots=True)
class _Lacking:
    """An observation that a robot has told of and that hasn't come."""

    seq: int
    ask_at_s: float
    patience_s: float = _PATIENCE_S


class RobotObservations:
    """The newest observation of each robot that is followed. For one thread.

    One question is asked at a time, the one that has waited longest first. So a robot that doesn't answer holds up others for
    ``_ANSWER_S`` at most.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._slots: dict[str, LatestMessage[FrameHeader]] = {}
        self._lacking: dict[str, _Lacking] = {}
        self._unheard: set[str] = set()
        self._answers: queue.SimpleQueue[tuple[str, Received[FrameHeader]]] = queue.SimpleQueue()
        self._asking: threading.Thread | None = None

    def __iter__(self) -> Iterator[str]:
        return iter(self._slots)

    def __len__(self) -> int:
        return len(self._slots)

    def follow(self, robot: str) -> None:
        """Subscribes to a robot's observations."""
        self._slots[robot] = self._node.latest(ROBOT_OBSERVATION, robot=robot)

    def forget(self, robot: str) -> None:
        """Ends that."""
        self._slots.pop(robot).close()
        self._lacking.pop(robot, None)

    def began_anew(self, robots: Collection[str]) -> None:
        """These robots have come or come back. Whatever number their newest observation has, it may be another one."""
        self._unheard |= set(robots)

    def poll(self) -> list[tuple[str, Received[FrameHeader]]]:
        """What came since the last call, of robots that are followed."""
        came = [(robot, frame) for robot, slot in self._slots.items() if (frame := slot.poll()) is not None]
        for robot, _ in came:
            self._lacking.pop(robot, None)
        while not self._answers.empty():
            robot, answer = self._answers.get()
            lacking = self._lacking.get(robot)
            if lacking is not None and answer.message.seq == lacking.seq:  # else it, or a newer one, came meanwhile
                came.append((robot, answer))
                del self._lacking[robot]
        self._unheard -= {robot for robot, _ in came}
        return came

    def ask_for_lost(self, statuses: Mapping[str, Received[RobotStatus]], newest: Mapping[str, int]) -> None:
        """Asks robots for observations that their ``statuses`` tell of and that haven't come. ``newest``: by robot, the sequence
        number of the one that came last."""
        now_s = time.monotonic()
        for robot, status in statuses.items():
            seq, lacking = status.message.seq, self._lacking.get(robot)
            if robot not in self._slots or (newest.get(robot) == seq and robot not in self._unheard):
                self._lacking.pop(robot, None)
            elif lacking is None or lacking.seq != seq:
                self._lacking[robot] = _Lacking(seq, now_s + _PATIENCE_S)
        due = [robot for robot in statuses if robot in self._lacking and now_s >= self._lacking[robot].ask_at_s]
        if due and (self._asking is None or not self._asking.is_alive()):
            robot = min(due, key=lambda robot: self._lacking[robot].ask_at_s)
            lacking = self._lacking[robot]
            lacking.patience_s = min(2 * lacking.patience_s, _MAX_PATIENCE_S)
            lacking.ask_at_s = now_s + lacking.patience_s
            self._node.log.info("asks a robot for its observation", robot=robot, seq=lacking.seq)
            arguments = robot, lacking.seq, statuses[robot].request_id
            self._asking = threading.Thread(target=self._ask, args=arguments, name=f"ask-{robot}", daemon=True)
            self._asking.start()

    def _ask(self, robot: str, seq: int, request_id: str) -> None:
        try:
            with bound_request_id(request_id):
                answer = self._node.ask(
                    ROBOT_OBSERVATION, robot=robot, timeout_s=_ANSWER_S, parameters={"seq": str(seq)}
                )
            self._answers.put((robot, answer))
            self._node.wake.set()
        except BusError as error:
            self._node.warn_seldom("a robot's observation didn't come", robot=robot, error=str(error))
