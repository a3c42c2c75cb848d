"""Discrete actions by velocities: on a robot that obeys, one that slips sideways, and one in front of a wall."""

from __future__ import annotations

import math
import threading

import pytest

from surveilnav.robot_body import STEP_M, TURN_RAD
from surveilnav.robot_frame import PlanarTransform
from surveilnav.services.robot_node.bodies.ros2 import velocity
from surveilnav.services.robot_node.bodies.ros2.velocity import VelocityDrive, velocity_towards

DT_S = 0.05


class Wheels:
    """A robot that moves by the last velocity whenever its pose is asked, as if a period had passed."""

    def __init__(self, pose, wall_m=math.inf, slip=0.0):
        self.pose, self.wall_m, self.slip = pose, wall_m, slip
        self.sent = []

    def put(self, twist):
        self.sent.append((twist.linear.x, twist.angular.z))

    def __call__(self):
        forward, turn = self.sent[-1] if self.sent else (0.0, 0.0)
        self.pose = self.pose @ PlanarTransform(forward * DT_S, self.slip * forward * DT_S, turn * DT_S)
        if self.pose.x_m > self.wall_m:
            self.pose = PlanarTransform(self.wall_m, self.pose.y_m, self.pose.yaw_rad)
        return self.pose


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(velocity, "_PERIOD_S", 0.0)
    monkeypatch.setattr(velocity, "_TIMEOUT_S", 0.5)


@pytest.mark.parametrize("slip", [0.0, 0.1])
@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
def test_an_action_ends_where_it_should(yaw, slip):
    for action, moved, turned in (
        ("move_forward", STEP_M, 0.0),
        ("turn_left", 0.0, TURN_RAD),
        ("turn_right", 0.0, -TURN_RAD),
    ):
        start = PlanarTransform(1.0, 2.0, yaw)
        wheels = Wheels(start, slip=slip)
        assert VelocityDrive(wheels, False, wheels).act(action)
        done = start.inverse() @ wheels.pose
        assert done.x_m == pytest.approx(moved, abs=0.02)
        assert abs(done.y_m) < 0.03
        assert math.degrees(done.yaw_rad - turned) == pytest.approx(0.0, abs=2.0)
        assert wheels.sent[-1] == (0.0, 0.0)


def test_speeds_stay_within_their_limits():
    wheels = Wheels(PlanarTransform())
    VelocityDrive(wheels, False, wheels).act("move_forward")
    assert max(forward for forward, _ in wheels.sent) <= 0.25
    assert velocity_towards(PlanarTransform(-0.1, 0.0, 0.0), PlanarTransform()) is None, "it never drives backwards"


def test_a_wall_cuts_it_short():
    wheels = Wheels(PlanarTransform(), wall_m=0.1)
    assert not VelocityDrive(wheels, False, wheels).act("move_forward")
    assert wheels.sent[-1] == (0.0, 0.0)


def test_a_halt_ends_it_at_once(monkeypatch):
    monkeypatch.setattr(velocity, "_TIMEOUT_S", 20.0)
    monkeypatch.setattr(velocity, "_PERIOD_S", 0.01)
    wheels = Wheels(PlanarTransform(), wall_m=0.1)
    drive, done = VelocityDrive(wheels, False, wheels), []
    acting = threading.Thread(target=lambda: done.append(drive.act("move_forward")))
    acting.start()
    while not wheels.sent:
        pass
    drive.halt()
    acting.join(5.0)
    assert done == [False]
    assert wheels.sent[-1] == (0.0, 0.0)
