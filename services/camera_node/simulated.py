"""Runs one camera of a simulated building."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from surveilnav.bus import Answer, BusSettings, Node, Refused, Request, clock_ns
from surveilnav.contract import TRUTH
from surveilnav.perception.backend import Backend
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.edge_perception import open_edge_perception
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.sources.masked import hide_mask_zones
from surveilnav.services.camera_node.sources.simulated import SimulatedSource
from surveilnav.services.camera_node.sources.source import Source
from surveilnav.services.camera_node.taking import take_camera
from surveilnav.services.camera_node.zones import read_zones
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


def run_simulated_camera(settings: CameraSettings, bus: BusSettings) -> None:
    """Runs one simulated camera until SIGTERM."""
    building = SimulatedBuilding(SimulationSettings())
    plan = building.plan
    names = [camera.name for camera in plan.cameras]
    if settings.masks:  # checked before a camera is leased: zones of a misspelt camera name would mask nothing
        read_zones(Path(settings.masks), "", 0, names)
    with take_camera(settings.id, lambda: names, f"the plan of {plan.building}", bus) as (name, node):
        source = SimulatedSource(building, plan.cameras[names.index(name)])
        serve_truth(node, hide_mask_zones(source, settings))
        own = OwnPerception(
            source, partial(_backend, building, settings), lambda name: node.log.info("looks by itself", backend=name)
        )
        service = CameraService(node, source, settings, own)
        with open_edge_perception(
            node,
            source,
            settings,
            own=own,
            n_floors=len(plan.floors),
            busy=lambda: service.sending or service.paused,
        ):
            node.run(service.step, idle_s=0.02)


def serve_truth(node: Node, source: Source) -> None:
    """Answers which instance each pixel of a view shows; only the backends oracle and simulated ever ask.

    A rendered view doesn't change, so the answer is the same for every ``seq`` under which it was sent.
    """

    def answer(request: Request) -> Answer:
        seq, view = request.parameters.get("seq", ""), request.ids.get("view", "")
        if not (seq.isdecimal() and view.isdecimal() and int(view) < len(source.views)):
            raise Refused("no_truth", "expected one of the camera's views, and its seq")
        truth = source.latest(int(view)).truth
        assert truth is not None, "a simulated source knows it"
        name = f"camera/{source.place.name}"
        return Answer(*truth_to_wire(truth, source=name, view=int(view), seq=int(seq), stamp_ns=clock_ns()))

    node.serve(TRUTH, answer, source=f"camera-{source.place.name}")


def _backend(building: SimulatedBuilding, settings: CameraSettings) -> Backend:
    from surveilnav.simulator.truth.choose import choose_backend  # loads ONNX Runtime, which few cameras need

    return choose_backend(
        settings.perception, threads=settings.threads, seed=building.settings.seed, download=settings.download
    )
