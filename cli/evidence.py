"""What a run's report shows, asked of the running system at the mission's end. What nobody tells is left out."""

from __future__ import annotations

import cv2
import numpy as np

from surveilnav.bus import Node, clock_ns
from surveilnav.cli.recorder import Recorder
from surveilnav.cli.report.record import DecidingView, Layers, Step
from surveilnav.contract import CAMERA_REQUEST, MAP_LAYER, OBJECTS
from surveilnav.errors import BusError, WireError
from surveilnav.geometry import yaw_of
from surveilnav.messages import CameraRequest, MissionStatus, ObjectEvent, ObjectRecord
from surveilnav.sensing.layers import GRID_LAYERS, unpack_layer

_MOST_DECIDING_VIEWS = 6


def trajectory(recorder: Recorder) -> list[Step]:
    """Where the robot was at the start and after each action."""
    steps = []
    for seq in sorted(recorder.observations):
        header, jpeg = recorder.observations[seq]
        x_m, y_m, _ = header.T_world_base.translation_m
        yaw_rad = yaw_of(header.T_world_base.matrix())
        steps.append(
            Step(
                x_m,
                y_m,
                header.floor,
                seq,
                header.stamp_ns,
                recorder.arrived_s[seq],
                yaw_rad,
                header.path_m,
                header.last_action or "",
                header.collided,
                jpeg,
            )
        )
    return steps


def actions(recorder: Recorder) -> list[str]:
    """What the robot did, one after the other."""
    headers = [recorder.observations[seq][0] for seq in sorted(recorder.observations)]
    return [header.last_action for header in headers if header.last_action]


def layers(node: Node, floor: str, target: str) -> Layers:
    """The map layers of a floor; values are those of ``target``."""
    found: Layers = {}
    for layer in GRID_LAYERS:
        parameters = {"target": target} if layer == "value" else None
        try:
            answer = node.ask(MAP_LAYER, floor=floor, layer=layer, parameters=parameters)
            found[layer] = (answer.message.grid, unpack_layer(layer, answer.message, answer.payload))
        except (BusError, WireError) as error:
            node.log.warning("the report lacks a layer", layer=layer, error=str(error))
    return found


def objects(node: Node, floor: str) -> list[ObjectRecord]:
    """Asks fusion for the objects of a floor, each with its whole history.

    If fusion doesn't answer, a warning is logged and the list is empty.
    """
    try:
        return list(node.ask(OBJECTS, floor=floor, parameters={"history": "all"}).message.objects)
    except BusError as error:
        node.log.warning("the report lacks the objects", error=str(error))
        return []


def deciding_views(
    node: Node, recorder: Recorder, known: list[ObjectRecord], status: MissionStatus
) -> list[DecidingView]:
    """The views in which the object that was found was seen best, robot's and cameras'."""
    chosen = next((o for o in known if o.id == status.object_id), None)
    if chosen is None:
        return []
    best: dict[tuple[str, int], ObjectEvent] = {}
    for event in sorted(chosen.history, key=lambda e: e.score):
        if event.box_px is not None:
            best[event.source, event.view if event.source.startswith("camera/") else event.seq] = event
    views: list[DecidingView] = []
    for event in sorted(best.values(), key=lambda e: -e.score):
        if len(views) < _MOST_DECIDING_VIEWS and (view := _deciding_view(node, recorder, event)):
            views.append(view)
    return views


def _deciding_view(node: Node, recorder: Recorder, event: ObjectEvent) -> DecidingView | None:
    picture = _picture(node, recorder, event)
    if picture is None or event.box_px is None:
        return None
    jpeg, scale = picture
    x0, y0, x1, y1 = (v * scale for v in event.box_px)
    from_camera = event.source.startswith("camera/")
    caption = f"{event.source}, view {event.view}" if from_camera else f"robot, step {event.seq}"
    return DecidingView(caption, jpeg, [(x0, y0, x1, y1, event.label, event.score)])


def _picture(node: Node, recorder: Recorder, event: ObjectEvent) -> tuple[bytes, float] | None:
    """(JPEG, scale of its pixels against the view's) of the view of an event."""
    kind, _, name = event.source.partition("/")
    if kind == "robot":
        seen = recorder.observations.get(event.seq)
        return (seen[1], 1.0) if seen else None
    info = next((i for i in recorder.camera_infos() if i.camera == name), None)
    if info is None:
        return None
    request = CameraRequest(stamp_ns=clock_ns(), action="thumbnail", views=[event.view])
    try:
        jpeg = node.ask(CAMERA_REQUEST, request, floor=info.floor, camera=name).payload
    except BusError:
        return None
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return None if picture is None else (jpeg, picture.shape[1] / info.intrinsics.width_px)
