"""Where the robot is in the building: frames, restarts, corrections, and what isn't trusted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import base_pose
from surveilnav.robot_file import RobotFile
from surveilnav.robot_frame import PlanarTransform
from surveilnav.ros2 import types
from surveilnav.services.robot_node.bodies.ros2 import place as place_module
from surveilnav.services.robot_node.bodies.ros2.place import RobotPlace
from surveilnav.services.robot_node.bodies.ros2.transforms import TransformBuffer, TransformError

S = 10**9
FRAME = {"x_m": 10.0, "y_m": -2.0, "yaw_deg": 90.0}


def header(frame, stamp_ns):
    stamp = types.make("builtin_interfaces/msg/Time", sec=stamp_ns // S, nanosec=stamp_ns % S)
    return types.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def pose_of(x, y, yaw):
    q = types.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return types.make(
        "geometry_msgs/msg/Pose", position=types.make("geometry_msgs/msg/Point", x=x, y=y, z=0.0), orientation=q
    )


def odometry(x, y=0.0, yaw=0.0, stamp_ns=0, speed=0.0):
    zero = types.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    forward = types.make("geometry_msgs/msg/Vector3", x=speed, y=0.0, z=0.0)
    twist = types.make("geometry_msgs/msg/Twist", linear=forward, angular=zero)
    return types.make(
        "nav_msgs/msg/Odometry",
        header=header("odom", stamp_ns),
        child_frame_id="base_link",
        pose=types.make("geometry_msgs/msg/PoseWithCovariance", pose=pose_of(x, y, yaw), covariance=np.zeros(36)),
        twist=types.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def tf(parent, child, x, y=0.0, yaw=0.0, stamp_ns=0, z=0.0):
    pose = pose_of(x, y, yaw)
    transform = types.make(
        "geometry_msgs/msg/Transform",
        translation=types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        rotation=pose.orientation,
    )
    stamped = types.make(
        "geometry_msgs/msg/TransformStamped", header=header(parent, stamp_ns), child_frame_id=child, transform=transform
    )
    return types.make("tf2_msgs/msg/TFMessage", transforms=[stamped])


def sure_to(sigma_m):
    covariance = np.zeros(36)
    covariance[[0, 7]] = sigma_m**2, (sigma_m / 2) ** 2
    return types.make(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        header=header("map", 0),
        pose=types.make("geometry_msgs/msg/PoseWithCovariance", pose=pose_of(0, 0, 0), covariance=covariance),
    )


class Robot:
    """A robot whose odometry and localisation the test tells."""

    def __init__(self, **changes):
        facts = {"router": "tcp/127.0.0.1:1", "floor": "0", "floor_z_m": 3.0, "T_building_map": FRAME} | changes
        self.place = RobotPlace(RobotFile.model_validate(facts), TransformBuffer())
        self.place.add_transforms(tf("base_link", "camera", 0.1, z=0.9), static=True)

    def drive(self, x, y=0.0, yaw=0.0, stamp_ns=S, sender=b"a"):
        self.place.add_transforms(tf("odom", "base_link", x, y, yaw, stamp_ns), static=False)
        self.place.add_odometry(odometry(x, y, yaw, stamp_ns), sender)

    def localise(self, x, y=0.0, yaw=0.0, stamp_ns=S):
        self.place.add_transforms(tf("map", "odom", x, y, yaw, stamp_ns), static=False)


@pytest.fixture
def robot():
    robot = Robot()
    robot.localise(1.0)
    robot.drive(2.0)
    return robot


def test_its_place_is_the_product_of_frame_localisation_and_odometry(robot):
    at = robot.place.base_in_building()
    assert (at.x_m, at.y_m, at.yaw_rad) == pytest.approx((10.0, 1.0, math.pi / 2))
    T = robot.place.camera_in_building("camera", S)
    np.testing.assert_allclose(T, base_pose((10.0, 1.1, 3.9), math.pi / 2), atol=1e-9)
    assert robot.place.problem() == ""


def test_a_waypoint_goes_into_its_map_and_back(robot):
    pose = robot.place.to_map(10.0, 1.0, math.pi)
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((3.0, 0.0, math.pi / 2))


def test_the_way_is_counted_by_odometry(robot):
    for k in range(1, 5):
        robot.drive(2.0, 0.1 * k, stamp_ns=S + k * S // 10)
    assert robot.place.path_m == pytest.approx(0.4)


def test_without_the_frame_its_place_is_not_known():
    robot = Robot(T_building_map=None)
    robot.localise(1.0)
    robot.drive(2.0)
    assert (
        robot.place.problem() == "where its map lies in the building isn't known: measure it (surveilnav robots frame)"
    )
    with pytest.raises(TransformError):
        robot.place.base_in_building()
    robot.place.set_frame(PlanarTransform())
    assert robot.place.problem() == ""


@pytest.mark.parametrize(
    ("x", "stamp_ns", "sender"),
    [
        (0.0, 20 * S + S // 10, b"a"),  # at its origin again
        (5.0, 21 * S, b"b"),  # another process
        (5.0, 5 * S, b"a"),  # another clock
    ],
)
def test_a_robot_without_localisation_is_lost_once_its_odometry_begins_anew(x, stamp_ns, sender):
    robot = Robot(frames={"map": "odom"})
    robot.drive(5.0, stamp_ns=20 * S)
    assert robot.place.problem() == ""
    robot.place.add_odometry(odometry(x, stamp_ns=stamp_ns), sender)
    assert "its odometry began anew" in robot.place.problem()
    with pytest.raises(TransformError):
        robot.place.camera_in_building("camera", 20 * S)
    robot.place.set_frame(PlanarTransform(1.0, 2.0, 0.0))
    assert robot.place.problem() == ""
    assert robot.place.base_in_building().x_m == pytest.approx(6.0)


def test_what_was_driven_while_messages_were_missing_is_no_restart():
    robot = Robot(frames={"map": "odom"})
    robot.drive(0.0, stamp_ns=20 * S)
    robot.drive(1.5, stamp_ns=22 * S)
    assert robot.place.problem() == ""
    assert robot.place.path_m == pytest.approx(1.5)


def test_a_localisation_must_place_it_again_after_a_restart(robot):
    robot.drive(0.0, stamp_ns=3 * S, sender=b"b")
    assert robot.place.problem() == "its odometry began anew, and its localisation hasn't placed it since"
    robot.localise(3.0, stamp_ns=4 * S)
    assert robot.place.problem() == ""
    assert robot.place.base_in_building().y_m == pytest.approx(1.0)


def test_a_correction_by_its_localisation_is_noted(robot):
    robot.place.record_corrections()
    robot.drive(2.2, stamp_ns=2 * S)
    robot.place.record_corrections()
    assert robot.place.notes == []
    robot.localise(1.4, 0.3, stamp_ns=2 * S)
    robot.place.record_corrections()
    assert robot.place.notes == ["its localisation moved it by 0.50 m and 0 degrees at once"]


def test_a_localisation_that_jumps_far_is_a_problem_until_a_person_has_looked(robot):
    robot.place.record_corrections()
    robot.localise(4.0, 0.3, stamp_ns=2 * S)
    robot.place.record_corrections()
    assert robot.place.problem().startswith("its localisation moved it by")
    assert "save its robot file again" in robot.place.problem()
    robot.place.record_corrections()
    assert robot.place.problem(), "it doesn't pass by itself"
    robot.place.set_frame(PlanarTransform())
    robot.place.record_corrections()
    assert robot.place.problem() == ""


def test_a_localisation_that_says_that_it_is_lost_is_believed(robot):
    robot.place.add_localisation(sure_to(0.8))
    assert robot.place.problem() == "its localisation is lost: it knows its place to 0.8 m only"
    robot.place.add_localisation(sure_to(0.1))
    assert robot.place.problem() == ""


def test_silent_odometry_is_named(robot, monkeypatch):
    now_s = place_module.time.monotonic()
    monkeypatch.setattr(place_module.time, "monotonic", lambda: now_s + 5.0)
    assert robot.place.problem() == "no odometry came for 5 s on 'odom'"


def test_missing_transforms_are_named():
    robot = Robot()
    robot.drive(2.0)
    assert "no transform leads from 'odom' to 'map'" in robot.place.problem()


def test_transforms_that_cannot_be_are_left_out(robot):
    broken = tf("odom", "base_link", math.nan, stamp_ns=2 * S)
    robot.place.add_transforms(broken, static=False)
    robot.place.add_odometry(odometry(math.inf, stamp_ns=2 * S), b"a")
    assert robot.place.problem() == ""
    assert robot.place.path_m == 0.0
