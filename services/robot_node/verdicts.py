"""What a simulator says of a stop: whether the robot stood where it should. A real robot has nobody to say so."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

from surveilnav.bus import Answer, Node, Request, clock_ns
from surveilnav.contract import JUDGED, MISSION_STATUS
from surveilnav.errors import SurveilNavError
from surveilnav.messages import Judged
from surveilnav.services.robot_node.core import RobotState

#: ``judge(target, state)``: (whether it is a success, the way to the nearest place that counts [m]); None: no such thing
#: is known in the building, as with words for what nobody labelled.
Judge = Callable[[str, RobotState], tuple[bool, float | None] | None]

#: Of so many missions the verdict is remembered.
_MOST = 1000


class Verdicts:
    """Judges each stop on a thread of its own, puts the verdict, and answers with it whoever asks later. Without a ``judge``
    it says nothing."""

    def __init__(self, node: Node, robot: str, judge: Judge | None) -> None:
        self._node, self._robot, self._judge, self._source = node, robot, judge, f"robot-{robot}"
        self._told: OrderedDict[str, Judged] = OrderedDict()
        self._lock = threading.Lock()
        if judge is not None:
            node.serve(JUDGED, self._answer, source=self._source)

    def acted(self, state: RobotState) -> None:
        """The robot has come to ``state``. If it called ``stop``, its mission is judged."""
        if state.stopped and state.mission and (judge := self._judge):
            threading.Thread(target=self._judged, args=(judge, state), name="verdict", daemon=True).start()

    def _judged(self, judge: Judge, state: RobotState) -> None:
        try:
            status = self._node.ask(MISSION_STATUS, mission=state.mission).message
        except SurveilNavError as error:  # its planner is gone: nobody knows what was searched
            self._node.warn_seldom("a stop can't be judged", mission=state.mission, error=str(error))
            return
        if (found := judge(status.target, state)) is None:
            return
        success, distance_m = found
        verdict = Judged(
            stamp_ns=clock_ns(), mission=state.mission, robot=self._robot, success=success, distance_m=distance_m
        )
        with self._lock:
            self._told[state.mission] = verdict
            if len(self._told) > _MOST:
                self._told.popitem(last=False)
        publisher = self._node.publisher(JUDGED, source=self._source, mission=state.mission)
        publisher.put(verdict)
        publisher.close()

    def _answer(self, request: Request) -> list[Answer]:
        with self._lock:
            told = dict(self._told)
        wanted = request.ids.get("mission")
        return [
            Answer(v, ids={"source": self._source, "mission": id}) for id, v in told.items() if wanted in (None, id)
        ]
