"""Publishes a robot's observations, each once, and answers who lacks the newest one."""

from __future__ import annotations

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import ROBOT_OBSERVATION, TRUTH
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.robot_node.observation import EncodedObservation


class ObservationPublisher:
    """The observations of one robot on the bus."""

    def __init__(self, node: Node, robot: str) -> None:
        self._observations = node.publisher(ROBOT_OBSERVATION, robot=robot)
        self._truths = node.publisher(TRUTH, source=f"robot-{robot}", view=0)
        self._newest: EncodedObservation | None = None
        node.serve(ROBOT_OBSERVATION, self._answer, robot=robot)

    def publish(self, observation: EncodedObservation) -> None:
        """Publishes a new observation."""
        self._newest = observation
        self._put_truth(observation)
        self._observations.put(observation.message, observation.payload)

    def _answer(self, request: Request) -> Answer:
        """The newest observation; if the request names a ``seq``, only if it is this one."""
        newest, wanted = self._newest, request.parameters.get("seq")
        if newest is None or wanted not in (None, str(newest.message.seq)):
            raise Refused("busy", "the robot has no such observation (yet): ask again later")
        self._put_truth(newest)
        return Answer(newest.message, newest.payload)

    def _put_truth(self, observation: EncodedObservation) -> None:
        message, truth = observation.message, observation.truth
        if truth is not None and self._truths.matched:  # only the backends oracle and simulated ever listen
            self._truths.put(
                *truth_to_wire(truth, source=message.source, view=message.view, seq=message.seq, stamp_ns=clock_ns())
            )
