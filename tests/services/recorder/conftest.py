"""Messages that a recorder receives, made by hand."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
import structlog

from surveilnav import messages as m
from surveilnav.contract import ROBOT_STATUS, VIEW_LOG
from surveilnav.geometry import Pinhole, Pose, base_pose, camera_pose
from surveilnav.sensing.packing import encode_rgbd
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.core.bus_message import BusMessage

CAMERA = Pinhole.from_hfov(32, 24, 1.4)


def picture(seq: int) -> tuple[bytes, m.PayloadPart, m.PayloadPart]:
    """(payload, image, depth) of a small picture."""
    rgb = np.full((24, 32, 3), (seq * 40 % 256, 90, 30), np.uint8)
    return encode_rgbd(rgb, np.full((24, 32), 2.0, np.float32), depth_range_m=(0.1, 10.0))


def logged(number: int, source: str = "robot/r1") -> tuple[m.LoggedView, bytes]:
    """A view as fusion tells of it, and its picture."""
    payload, image, depth = picture(number)
    common: dict[str, Any] = {
        "stamp_ns": 10**9 * number,
        "source": source,
        "view": 0,
        "seq": number,
        "floor": "0",
        "camera": CAMERA,
        "T_world_camera": Pose.from_matrix(camera_pose((1.0, 2.0, 0.88), 0.3, -0.2)),
        "mounting_offset_m": 0.88,
        "depth_range_m": (0.1, 10.0),
        "image": image,
        "depth": depth,
    }
    if source.startswith("robot/"):
        header: m.FrameHeader = m.Observation(T_world_base=Pose.from_matrix(base_pose((1.0, 2.0, 0.0), 0.3)), **common)
    else:
        header = m.FrameHeader(**common)
    view = m.LoggedView(
        stamp_ns=10**9 * number,
        number=number,
        newest=number,
        source=source,
        header=msgspec.msgpack.encode(header),
        digest=bytes([number % 256]) * 16,
    )
    return view, payload


def view_message(number: int, source: str = "robot/r1") -> BusMessage:
    """The same, as the recorder receives it."""
    return BusMessage(VIEW_LOG, VIEW_LOG.key_for(building="b"), *logged(number, source), 10**9 * number + 5)


def status_message(seq: int = 1, message: str = "") -> BusMessage:
    """A small message."""
    status = m.RobotStatus(
        stamp_ns=10**9 * seq,
        robot="r1",
        floor="0",
        seq=seq,
        state="ready",
        message=message,
        T_world_base=Pose.from_matrix(base_pose((1.0, 2.0, 0.0), 0.3)),
    )
    return BusMessage(ROBOT_STATUS, ROBOT_STATUS.key_for(building="b", robot="r1"), status, b"", 10**9 * seq + 7)


@dataclass
class FakeNode:
    """What a writer needs of a node: a place to complain to."""

    said: list[str] = field(default_factory=list)
    stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.log = structlog.wrap_logger(None, processors=[self._hear])

    def _hear(self, _: object, __: str, event: dict[str, Any]) -> None:
        self.said.append(event["event"])
        raise structlog.DropEvent

    def warn_seldom(self, event: str, **_: object) -> None:
        self.said.append(event)


@dataclass(frozen=True)
class Tools:
    """The functions above, for tests: with importmode=importlib a test can't import its neighbours."""

    logged: object = staticmethod(logged)
    view_message: object = staticmethod(view_message)
    status_message: object = staticmethod(status_message)
    node: type[FakeNode] = FakeNode

    @staticmethod
    def settings(folder: Path, **more: Any) -> RecorderSettings:
        return RecorderSettings(folder=folder, min_free_mb=0, **more)

    @staticmethod
    def jpeg_of(data: bytes) -> np.ndarray | None:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


@pytest.fixture(scope="session")
def tools() -> Tools:
    return Tools()
