"""Runs a robot of the simulated building."""

from __future__ import annotations

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import TRUTH
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.robot_node.bodies.simulated import SimulatedBody, SimulatedJudge, open_simulated_body
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.service import RobotService
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


def run_simulated_robot(settings: RobotSettings) -> None:
    """Runs one simulated robot until SIGTERM."""
    building = SimulatedBuilding(SimulationSettings())
    body = open_simulated_body(building, settings)
    _ = building.renderer  # loads it now: the first observation then doesn't wait for it
    with Node("robot", settings.id) as node:
        serve_truth(node, settings.id, body)
        node.run(RobotService(node, body, settings, SimulatedJudge(building)).step)


def serve_truth(node: Node, robot: str, body: SimulatedBody) -> None:
    """Answers which instance each pixel of the robot's newest views shows; only the backends oracle and simulated ever ask."""

    def answer(request: Request) -> Answer:
        seq = request.parameters.get("seq", "")
        truth = body.truth(int(seq)) if seq.isdecimal() else None
        if truth is None:
            raise Refused("no_truth", "expected the seq of one of the robot's newest views")
        return Answer(*truth_to_wire(truth, source=f"robot/{robot}", view=0, seq=int(seq), stamp_ns=clock_ns()))

    node.serve(TRUTH, answer, source=f"robot-{robot}", view=0)
