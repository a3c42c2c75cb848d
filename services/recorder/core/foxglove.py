"""What a recording holds of a message: the message itself, and what Foxglove shows of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec
from foxglove_schemas_protobuf.Log_pb2 import Log

from surveilnav.contract import MAP_LAYER, OBJECTS
from surveilnav.errors import WireError
from surveilnav.messages import CameraInfo, LayerHeader, LoggedView, MissionStatus, ObjectList, Plan, Revision
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.layers import layer_message
from surveilnav.services.recorder.core.mcap_message import McapMessage, encode_bus_message, encode_foxglove
from surveilnav.services.recorder.core.pictures import view_messages
from surveilnav.services.recorder.core.scene import cameras_message, objects_message, plan_message
from surveilnav.services.recorder.core.shapes import to_timestamp

#: Recorded for Foxglove alone: a replay makes them anew from the views.
_FOXGLOVE_ONLY = (MAP_LAYER, OBJECTS)
_MAX_CAMERAS = 1000


@dataclass
class FoxgloveConverter:
    """Converts the messages of one recording, in their order. It remembers floors and cameras, which later messages need.

    Attributes:
        floor_z_m: altitude by floor.
        infos: the cameras by their ids.
        invoked: by floor, the cameras that are invoked.
        decisions: by mission, the last decision (what, why) that was logged.
        cameras_changed: a camera announced itself or changed since the cameras were drawn.
    """

    floor_z_m: dict[str, float] = field(default_factory=dict)
    infos: dict[str, CameraInfo] = field(default_factory=dict)
    invoked: dict[str, frozenset[str]] = field(default_factory=dict)
    decisions: dict[str, tuple[str, str]] = field(default_factory=dict)
    cameras_changed: bool = False

    def convert(self, message: BusMessage) -> list[McapMessage]:
        """What is written of a message. One that can't be drawn is written as it arrived."""
        original = [] if message.stream in _FOXGLOVE_ONLY else [encode_bus_message(message)]
        try:
            return original + self._foxglove(message)
        except (msgspec.DecodeError, ValueError, WireError):  # it comes from others, so it may be malformed
            return original

    def _foxglove(self, received: BusMessage) -> list[McapMessage]:
        payload, log_ns = received.payload, received.log_ns
        match received.message:
            case LoggedView() as view:
                return view_messages(view, payload, log_ns)
            case Revision() as revision:
                return self._cameras(revision, log_ns)
            case CameraInfo() as info:
                if info.camera in self.infos or len(self.infos) < _MAX_CAMERAS:
                    self.infos[info.camera] = info
                    self.cameras_changed = True  # drawn with the next revision: all cameras announce themselves at once
                return []
            case LayerHeader() as header:
                return [layer_message(header, payload, self.floor_z_m.get(header.floor, 0.0), log_ns)]
            case ObjectList() as objects:
                return [objects_message(objects, log_ns)]
            case Plan() as plan:
                scene = plan_message(plan, self.floor_z_m.get(plan.floor, 0.0), log_ns)
                return [scene, *self._decision(plan.mission, plan.action, plan.why, plan.stamp_ns, log_ns)]
            case MissionStatus() as status:
                return self._decision(status.mission, status.state, status.message, status.stamp_ns, log_ns)
            case _:
                return []

    def _cameras(self, revision: Revision, log_ns: int) -> list[McapMessage]:
        """The cameras of the building, if they or their invocation changed."""
        floor, cameras = revision.floor, frozenset(use.camera for use in revision.cameras)
        self.floor_z_m[floor] = revision.floor_z_m
        if not self.cameras_changed and self.invoked.get(floor, frozenset()) == cameras:
            return []
        self.invoked[floor], self.cameras_changed = cameras, False
        invoked = frozenset().union(*self.invoked.values())
        return [cameras_message(self.infos.values(), invoked, revision.stamp_ns, log_ns)]

    def _decision(self, mission: str, what: str, why: str, stamp_ns: int, log_ns: int) -> list[McapMessage]:
        """An entry in the log of decisions, unless it repeats the last one."""
        if not why or self.decisions.get(mission) == (what, why):
            return []
        self.decisions[mission] = what, why
        level = Log.ERROR if what == "failed" else Log.INFO
        log = Log(timestamp=to_timestamp(stamp_ns), level=level, name=mission, message=f"{what}: {why}")
        return [encode_foxglove("/decisions", log, log_ns, stamp_ns)]
