"""What the bus's tests share: messages to put, and a stranger on the bus who is no node."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import zenoh

from surveilnav.bus import BusSettings
from surveilnav.geometry import Pose
from surveilnav.messages import RobotStatus, Truth

POSE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@pytest.fixture
def status():
    """``status(seq)``: what a robot puts."""
    return lambda seq=0: RobotStatus(stamp_ns=1, robot="r1", floor="0", seq=seq, state="ready", T_world_base=POSE)


@pytest.fixture
def truth():
    """``truth(seq)``: a message of a stream with payload."""
    return lambda seq: Truth(stamp_ns=1, source="robot/r1", view=0, seq=seq, width_px=1, height_px=1, labels={})


@pytest.fixture
def stranger(bus: BusSettings) -> Iterator[zenoh.Session]:
    """A Zenoh session that keeps to no contract."""
    with zenoh.open(zenoh.Config.from_json5(bus.client_config())) as session:
        yield session
