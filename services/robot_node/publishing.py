"""Publishes a robot's observations, and repeats the newest one until a command follows."""

from __future__ import annotations

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import ROBOT_OBSERVATION, TRUTH
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.robot_node.observation import EncodedObservation

#: An observation that no command follows is published again after these pauses [s]: a full link may have dropped it.
_REPEAT_AFTER_S = (1.0, 2.0, 4.0, 8.0, 15.0, 30.0)


class ObservationPublisher:
    """The observations of one robot on the bus."""

    def __init__(self, node: Node, robot: str) -> None:
        self._observations = node.publisher(ROBOT_OBSERVATION, robot=robot)
        self._truths = node.publisher(TRUTH, source=f"robot-{robot}", view=0)
        self._newest: EncodedObservation | None = None
        self._published_s = 0.0
        self._repeats = 0
        self._was_heard = False

    def publish(self, observation: EncodedObservation, now_s: float) -> None:
        """Publishes a new observation."""
        self._newest, self._repeats = observation, 0
        self._put(observation, now_s)

    def repeat_if_due(self, now_s: float) -> None:
        """Publishes the newest observation again if that is due and somebody listens, or listens again."""
        is_heard, was_heard = self._observations.matched, self._was_heard
        self._was_heard = is_heard
        if is_heard and not was_heard:
            self._repeats = 0
        pause_s = _REPEAT_AFTER_S[min(self._repeats, len(_REPEAT_AFTER_S) - 1)]
        if self._newest is not None and now_s - self._published_s >= pause_s and is_heard:
            self._repeats += 1
            self._put(self._newest, now_s)

    def _put(self, observation: EncodedObservation, now_s: float) -> None:
        self._published_s = now_s
        message, truth = observation.message, observation.truth
        if truth is not None and self._truths.matched:  # only the backends oracle and simulated ever listen
            self._truths.put(
                *truth_to_wire(truth, source=message.source, view=message.view, seq=message.seq, stamp_ns=clock_ns())
            )
        self._observations.put(message, observation.payload)
