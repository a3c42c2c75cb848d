"""A robot publishes each observation once, and answers who asks for the newest one."""

from __future__ import annotations

import time

import numpy as np
import pytest

from surveilnav.bus import Refused
from surveilnav.contract import ROBOT_OBSERVATION
from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages import Observation, PayloadPart
from surveilnav.services.robot_node.publishing import ObservationPublisher
from tests.waiting import patient, until

HERE = Pose.from_matrix(np.eye(4))


def observation(seq: int) -> tuple[Observation, bytes]:
    message = Observation(
        stamp_ns=seq,
        source="robot/r1",
        view=0,
        seq=seq,
        floor="0",
        T_world_camera=HERE,
        camera=Pinhole(64, 48, 60.0, 60.0, 31.5, 23.5),
        mounting_offset_m=0.88,
        depth_range_m=(0.5, 5.0),
        image=PayloadPart("jpeg", 3),
        depth=PayloadPart("depth-invq-zstd", 2),
        T_world_base=HERE,
    )
    return message, b"rgbdd"


@pytest.fixture
def robot(make_node):
    return ObservationPublisher(make_node("robot", "r1"), "r1")


def test_each_observation_is_published_once(robot, make_node):
    heard = []
    make_node("test", "t", alive=False).subscribe(ROBOT_OBSERVATION, heard.append, robot="r1")
    until(lambda: robot._observations.matched)
    robot.publish(*observation(7))
    until(lambda: heard)
    time.sleep(1.5)
    assert [frame.message.seq for frame in heard] == [7]


def test_who_asks_gets_the_newest_one(robot, make_node):
    client = patient(make_node("test", "t", alive=False))
    with pytest.raises(Refused, match="no such observation"):
        client.ask(ROBOT_OBSERVATION, robot="r1")
    robot.publish(*observation(7))
    robot.publish(*observation(8))
    answer = client.ask(ROBOT_OBSERVATION, robot="r1")
    assert (answer.message.seq, answer.payload) == (8, b"rgbdd")
    assert client.ask(ROBOT_OBSERVATION, robot="r1", parameters={"seq": "8"}).message.seq == 8
    with pytest.raises(Refused, match="no such observation"):
        client.ask(ROBOT_OBSERVATION, robot="r1", parameters={"seq": "9"})
