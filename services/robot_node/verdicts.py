"""Simulation only: judges whether a robot that stops at what was found is at its target, and publishes the verdict."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

from surveilnav.bus import Answer, Node, Request, clock_ns, keep_request_id
from surveilnav.contract import JUDGED, MISSION_STATUS
from surveilnav.errors import SurveilNavError
from surveilnav.messages import Judged
from surveilnav.robot_state import RobotState

#: ``judge(target, state)`` returns whether the stop is a success, and the distance left to the nearest place that would
#: count [m] (None: no way leads there). It returns None as a whole if the building has nothing that is called ``target``.
Judge = Callable[[str, RobotState], tuple[bool, float | None] | None]

#: Verdicts of older missions are forgotten.
_MAX_VERDICTS = 1000


class StopJudge:
    """Judges each stop on a thread of its own, publishes the verdict, and answers queries for it afterwards."""

    def __init__(self, node: Node, robot: str, judge: Judge) -> None:
        self._node, self._robot, self._judge, self._source = node, robot, judge, f"robot-{robot}"
        self._verdicts: OrderedDict[str, Judged] = OrderedDict()
        self._lock = threading.Lock()
        node.serve(JUDGED, self._on_query, source=self._source)

    def judge_stop(self, state: RobotState) -> None:
        """Starts to judge the mission if the robot called ``stop`` in ``state``; otherwise does nothing.

        To be called only for a stop at what was found: a mission that failed is no success, wherever its robot came to stand.
        """
        if state.stopped and state.mission:
            publish = keep_request_id(self._publish_verdict)
            threading.Thread(target=publish, args=(state,), name="verdict", daemon=True).start()

    def _publish_verdict(self, state: RobotState) -> None:
        try:
            status = self._node.ask(MISSION_STATUS, mission=state.mission).message
        except SurveilNavError as error:  # without the planner nobody knows which target was searched
            self._node.warn_seldom("a stop can't be judged", mission=state.mission, error=str(error))
            return
        if (result := self._judge(status.target, state)) is None:
            return
        success, distance_m = result
        verdict = Judged(
            stamp_ns=clock_ns(), mission=state.mission, robot=self._robot, success=success, distance_m=distance_m
        )
        with self._lock:
            self._verdicts[state.mission] = verdict
            if len(self._verdicts) > _MAX_VERDICTS:
                self._verdicts.popitem(last=False)
        publisher = self._node.publisher(JUDGED, source=self._source, mission=state.mission)
        publisher.put(verdict)
        publisher.close()

    def _on_query(self, request: Request) -> list[Answer]:
        """The verdict of one mission, or of all."""
        with self._lock:
            verdicts = dict(self._verdicts)
        wanted = request.ids.get("mission")
        return [
            Answer(verdict, ids={"source": self._source, "mission": mission})
            for mission, verdict in verdicts.items()
            if wanted in (None, mission)
        ]
