"""Drives a robot without Nav2: carries out one discrete action by velocities, and looks at odometry to see when it is done."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from surveilnav.robot_body import STEP_M, TURN_RAD
from surveilnav.robot_frame import PlanarTransform
from surveilnav.ros2 import types
from surveilnav.ros2.session import RosPublisher

_PERIOD_S = 0.05
_MAX_SPEED_M_S, _MAX_TURN_RAD_S = 0.25, 0.8
#: What is left is driven at this many times itself per second, so that the robot slows down before the end.
_GAIN_PER_S = 2.0
_MIN_SPEED_M_S, _MIN_TURN_RAD_S = 0.04, 0.12
_DONE_M, _DONE_RAD = 0.015, math.radians(1.5)
#: An action that takes longer is cut short: something is in the way.
_TIMEOUT_S = 8.0
_TURNS = {"turn_left": TURN_RAD, "turn_right": -TURN_RAD}


@dataclass(frozen=True, slots=True)
class Velocity:
    """Forward [m/s] and anticlockwise [rad/s]."""

    forward_m_s: float = 0.0
    turn_rad_s: float = 0.0


def velocity_towards(goal: PlanarTransform, now: PlanarTransform) -> Velocity | None:
    """The velocity that brings the robot nearer to a pose straight ahead of it or on the spot; None: it is there.

    Both are in one frame. It never drives backwards: a robot that went too far stops.
    """
    ahead = now.inverse() @ goal
    if ahead.x_m > _DONE_M:
        speed = min(_MAX_SPEED_M_S, max(_MIN_SPEED_M_S, _GAIN_PER_S * ahead.x_m))
        steer = math.atan2(ahead.y_m, max(ahead.x_m, 0.1))
        return Velocity(speed, max(-_MAX_TURN_RAD_S, min(_MAX_TURN_RAD_S, _GAIN_PER_S * steer)))
    if abs(ahead.yaw_rad) > _DONE_RAD:
        rate = min(_MAX_TURN_RAD_S, max(_MIN_TURN_RAD_S, _GAIN_PER_S * abs(ahead.yaw_rad)))
        return Velocity(0.0, math.copysign(rate, ahead.yaw_rad))
    return None


class VelocityDrive:
    """Carries out discrete actions. ``T_odom_base`` gives the robot's pose by odometry; it may raise what it likes."""

    def __init__(self, publisher: RosPublisher, stamped: bool, T_odom_base: Callable[[], PlanarTransform]) -> None:
        self._publisher, self._stamped, self._T_odom_base = publisher, stamped, T_odom_base
        self._halted = threading.Event()

    def act(self, action: str) -> bool:
        """Turns or moves by one action. Returns whether it was carried out in full; a halt or an obstacle cuts it short."""
        self._halted.clear()
        step = PlanarTransform(0.0, 0.0, _TURNS[action]) if action in _TURNS else PlanarTransform(STEP_M, 0.0, 0.0)
        goal, until_s = self._T_odom_base() @ step, time.monotonic() + _TIMEOUT_S
        try:
            while time.monotonic() < until_s and not self._halted.is_set():
                velocity = velocity_towards(goal, self._T_odom_base())
                if velocity is None:
                    return True
                self.put(velocity)
                self._halted.wait(_PERIOD_S)
            return False
        finally:
            self.put(Velocity())

    def halt(self) -> None:
        """Ends the action, and sends a velocity of zero."""
        self._halted.set()
        self.put(Velocity())

    def put(self, velocity: Velocity) -> None:
        """Publishes one velocity."""
        twist = twist_message(velocity)
        if self._stamped:
            now_ns = time.time_ns()
            stamp = types.make("builtin_interfaces/msg/Time", sec=now_ns // 10**9, nanosec=now_ns % 10**9)
            header = types.make("std_msgs/msg/Header", stamp=stamp, frame_id="base_link")
            twist = types.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist)
        self._publisher.put(twist)


def twist_message(velocity: Velocity) -> Any:
    """geometry_msgs/Twist."""

    def vector(x: float = 0.0, z: float = 0.0) -> Any:
        return types.make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=z)

    return types.make(
        "geometry_msgs/msg/Twist", linear=vector(x=velocity.forward_m_s), angular=vector(z=velocity.turn_rad_s)
    )
