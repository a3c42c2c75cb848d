"""Publishes a robot's observations, each once, and answers who lacks the newest one."""

from __future__ import annotations

from surveilnav.bus import Answer, Node, Refused, Request
from surveilnav.contract import ROBOT_OBSERVATION
from surveilnav.messages import Observation


class ObservationPublisher:
    """The observations of one robot on the bus."""

    def __init__(self, node: Node, robot: str) -> None:
        self._observations = node.publisher(ROBOT_OBSERVATION, robot=robot)
        self._newest: tuple[Observation, bytes] | None = None
        node.serve(ROBOT_OBSERVATION, self._answer, robot=robot)

    def publish(self, observation: Observation, pictures: bytes) -> None:
        """Publishes a new observation with its encoded pictures."""
        self._newest = observation, pictures
        self._observations.put(observation, pictures)

    def _answer(self, request: Request) -> Answer:
        """The newest observation; if the request names a ``seq``, only if it is this one."""
        newest, wanted = self._newest, request.parameters.get("seq")
        if newest is None or wanted not in (None, str(newest[0].seq)):
            raise Refused("busy", "the robot has no such observation (yet): ask again later")
        return Answer(*newest)
