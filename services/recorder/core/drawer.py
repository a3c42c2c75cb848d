"""What a recording holds of a message: itself, and what Foxglove draws of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import msgspec
from foxglove_schemas_protobuf.Log_pb2 import Log

from surveilnav.contract import MAP_LAYER, OBJECTS, Stream
from surveilnav.errors import WireError
from surveilnav.messages import (
    CameraInfo,
    LayerHeader,
    LoggedView,
    MissionStatus,
    ObjectList,
    Plan,
    Revision,
)
from surveilnav.messages.base import Message
from surveilnav.services.recorder.core.layers import layer_line
from surveilnav.services.recorder.core.line import Line, bus_line, drawn_line
from surveilnav.services.recorder.core.pictures import view_lines
from surveilnav.services.recorder.core.scene import cameras_line, objects_line, plan_line
from surveilnav.services.recorder.core.shapes import time_of

#: Drawn only: fusion makes them anew from the views whenever it is asked.
_DRAWN_ONLY = (MAP_LAYER, OBJECTS)
_MOST_CAMERAS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """A message on its way into the files. ``log_ns``: when the recorder had it."""

    stream: Stream
    key: str
    message: Message
    payload: bytes
    log_ns: int


@dataclass
class Drawer:
    """Turns what was heard into the lines of one file, in the order of hearing. It remembers what drawing needs: floors and
    cameras."""

    floor_z_m: dict[str, float] = field(default_factory=dict)
    infos: dict[str, CameraInfo] = field(default_factory=dict)
    invoked: dict[str, frozenset[str]] = field(default_factory=dict)
    said: dict[str, tuple[str, str]] = field(default_factory=dict)
    redraw: bool = False

    def lines(self, heard: Heard) -> list[Line]:
        """What is written of it. What can't be drawn is written as it came."""
        own = [] if heard.stream in _DRAWN_ONLY else [self._own(heard)]
        try:
            return own + self._drawn(heard.message, heard.payload, heard.log_ns)
        except (msgspec.DecodeError, ValueError, WireError):  # remote data
            return own

    @staticmethod
    def _own(heard: Heard) -> Line:
        return bus_line(heard.stream, heard.key, heard.message, heard.payload, heard.log_ns)

    def _drawn(self, message: Any, payload: bytes, log_ns: int) -> list[Line]:
        match message:
            case LoggedView():
                return view_lines(message, payload, log_ns)
            case Revision():
                self.floor_z_m[message.floor] = message.floor_z_m
                return self._invoke(
                    message.floor, frozenset(u.camera for u in message.cameras), message.stamp_ns, log_ns
                )
            case CameraInfo():
                if message.camera in self.infos or len(self.infos) < _MOST_CAMERAS:
                    self.infos[message.camera] = message
                    self.redraw = True  # with the next revision: a building's cameras announce themselves all at once
                return []
            case LayerHeader():
                return [layer_line(message, payload, self.floor_z_m.get(message.floor, 0.0), log_ns)]
            case ObjectList():
                return [objects_line(message, log_ns)]
            case Plan():
                plan = plan_line(message, self.floor_z_m.get(message.floor, 0.0), log_ns)
                return [plan, *self._decision(message.mission, message.action, message.why, message.stamp_ns, log_ns)]
            case MissionStatus():
                return self._decision(message.mission, message.state, message.message, message.stamp_ns, log_ns)
            case _:
                return []

    def _invoke(self, floor: str, cameras: frozenset[str], stamp_ns: int, log_ns: int) -> list[Line]:
        if not self.redraw and self.invoked.get(floor, frozenset()) == cameras:
            return []
        self.invoked[floor], self.redraw = cameras, False
        invoked = frozenset().union(*self.invoked.values())
        return [cameras_line(self.infos.values(), invoked, stamp_ns, log_ns)]

    def _decision(self, mission: str, what: str, why: str, stamp_ns: int, log_ns: int) -> list[Line]:
        """A line of the log of decisions, where it says something new."""
        if not why or self.said.get(mission) == (what, why):
            return []
        self.said[mission] = what, why
        level = Log.ERROR if what == "failed" else Log.INFO
        log = Log(timestamp=time_of(stamp_ns), level=level, name=mission, message=f"{what}: {why}")
        return [drawn_line("/decisions", log, log_ns, stamp_ns)]
