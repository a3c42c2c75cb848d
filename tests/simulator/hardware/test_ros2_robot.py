"""The simulated ROS 2 robot over a real router, as the software of a real robot's user meets it."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from surveilnav.bus.router import free_port, open_router
from surveilnav.geometry import Pose, camera_pose
from surveilnav.robot_frame import PlanarTransform
from surveilnav.ros2 import types
from surveilnav.ros2.names import Qos
from surveilnav.ros2.navigate_to_pose import GoalPose, GoalStatus, NavigateToPose
from surveilnav.ros2.session import RosError, RosMessage, RosSession
from surveilnav.simulator.hardware.config import RobotHardwareSettings
from surveilnav.simulator.hardware.ros2_robot import Ros2Robot, run
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from tests.waiting import repeat_until, until

WAIT_S = 30.0
KEPT = Qos(transient_local=True, depth=1)
T_BUILDING_MAP = PlanarTransform(3.0, -2.0, math.radians(120))
TYPES = {
    "odom": "nav_msgs/msg/Odometry",
    "ground_truth": "nav_msgs/msg/Odometry",
    "tf": "tf2_msgs/msg/TFMessage",
    "scan": "sensor_msgs/msg/LaserScan",
    "battery_state": "sensor_msgs/msg/BatteryState",
    "clock": "rosgraph_msgs/msg/Clock",
    "camera/color/image_raw": "sensor_msgs/msg/Image",
    "camera/depth/image_raw": "sensor_msgs/msg/Image",
    "camera/color/camera_info": "sensor_msgs/msg/CameraInfo",
    "camera/color/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "camera/depth/image_raw/compressedDepth": "sensor_msgs/msg/CompressedImage",
}


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        yield endpoint


@pytest.fixture(scope="module")
def building(home_cache: Path) -> SimulatedBuilding:
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        building = SimulatedBuilding(SimulationSettings(building="parametric_flat", lighting="flat", depth_noise=False))
        _ = building.renderer
        return building


class Rig:
    """A robot that runs on a thread, and a user's node that has heard of it."""

    def __init__(self, robot: Ros2Robot, user: RosSession) -> None:
        self.robot, self.user, self.navigation = robot, user, NavigateToPose(user)
        self.heard: dict[str, list[Any]] = defaultdict(list)

    def listen(self, *topics: str, qos: Qos | None = None, type_name: str = "") -> None:
        for topic in topics:

            def receive(message: RosMessage, topic: str = topic) -> None:
                self.heard[topic].append(message.data)

            self.user.subscribe(topic, type_name or TYPES[topic], receive, qos)

    def wait(self, topic: str, n: int = 1) -> list[Any]:
        until(lambda: len(self.heard[topic]) >= n, lambda: {k: len(v) for k, v in self.heard.items()}, WAIT_S)
        return self.heard[topic]

    def goal_at(self, dx_m: float, dy_m: float, yaw_rad: float = 0.0) -> GoalPose:
        """A pose in the robot's map, that lies so far from the robot in the building."""
        here = self.robot.robot.pose
        there = PlanarTransform(here.x_m + dx_m, here.y_m + dy_m, yaw_rad)
        wanted = self.robot.robot.localisation.T_building_map.inverse() @ there
        return GoalPose("map", wanted.x_m, wanted.y_m, wanted.yaw_rad)


@pytest.fixture
def rig(router: str, building: SimulatedBuilding) -> Iterator[Callable[..., Rig]]:
    """``rig(setting=...)``: a robot in a domain of its own."""
    with ExitStack() as stack:

        def start(**more: Any) -> Rig:
            settings = RobotHardwareSettings(
                router=router,
                domain=int.from_bytes(os.urandom(1), "big") % 200 + 1,
                **{
                    "start": "5,4,0,0",
                    "map_x_m": T_BUILDING_MAP.x_m,
                    "map_y_m": T_BUILDING_MAP.y_m,
                    "map_yaw_deg": 120.0,
                    "camera_width_px": 160,
                    "camera_height_px": 120,
                    **more,
                },
            )
            node = stack.enter_context(
                RosSession("robot", router=router, domain=settings.domain, namespace=settings.namespace)
            )
            user = stack.enter_context(
                RosSession("user", router=router, domain=settings.domain, namespace=settings.namespace)
            )
            robot = Ros2Robot(node, building, settings)
            stack.enter_context(running(robot))
            return Rig(robot, user)

        yield start


@contextmanager
def running(robot: Ros2Robot) -> Iterator[None]:
    ended = threading.Event()
    thread = threading.Thread(target=run, args=(robot, ended))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def planar(transform: Any) -> PlanarTransform:
    p, q = transform.translation, transform.rotation
    return PlanarTransform(p.x, p.y, 2 * math.atan2(q.z, q.w))


def planar_pose(odometry: Any) -> PlanarTransform:
    p, q = odometry.pose.pose.position, odometry.pose.pose.orientation
    return PlanarTransform(p.x, p.y, 2 * math.atan2(q.z, q.w))


def transforms(messages: list[Any], parent: str) -> dict[int, Any]:
    """By stamp."""
    found = [t for m in messages for t in m.transforms if t.header.frame_id == parent]
    return {stamp_ns(t): t.transform for t in found}


def shared_stamps(rig: Rig, pictures: Sequence[str]) -> list[int]:
    """The stamps, in order, of which every topic holds a message, and tf a place on the map.

    The robot learns of a user's subscriptions one after another, so one topic's first message may be another's second.
    """
    stamps = [{stamp_ns(m) for m in list(rig.heard[topic])} for topic in (*pictures, "odom", "ground_truth")]
    known, placed = (transforms(list(rig.heard["tf"]), parent) for parent in ("odom", "map"))
    return sorted(s for s in set(known).intersection(*stamps) if min(placed, default=s + 1) <= s)


def test_pictures_odometry_and_tf_belong_together_by_their_stamps(rig, building):
    r = rig(camera_tilt_deg=-20.0, camera_height_m=0.7, drift=0.02)
    r.listen(
        "odom", "ground_truth", "tf", "camera/color/image_raw", "camera/depth/image_raw", "camera/color/camera_info"
    )
    r.listen("tf_static", qos=KEPT, type_name=TYPES["tf"])
    r.navigation.send(r.goal_at(-2.0, 0.0), WAIT_S)
    pictures = ("camera/color/image_raw", "camera/depth/image_raw", "camera/color/camera_info")
    until(lambda: len(shared_stamps(r, pictures)) >= 3, timeout_s=WAIT_S)
    stamp = shared_stamps(r, pictures)[2]
    color, depth, info = (next(m for m in r.heard[topic] if stamp_ns(m) == stamp) for topic in pictures)
    assert (color.encoding, depth.encoding, color.width, depth.step) == ("rgb8", "16UC1", 160, 320)
    assert info.k[0] == pytest.approx(info.p[0])
    odometry = next(m for m in r.heard["odom"] if stamp_ns(m) == stamp)
    T_odom_base = planar(transforms(r.heard["tf"], "odom")[stamp])
    assert planar_pose(odometry).difference(T_odom_base) == pytest.approx((0, 0), abs=1e-9)
    # The localisation is good to some centimetres, so frames and truth agree; and the picture is of that very pose.
    known = transforms(r.heard["tf"], "map")
    T_map_odom = planar(known[max(s for s in known if s <= stamp)])
    true = planar_pose(next(m for m in r.heard["ground_truth"] if stamp_ns(m) == stamp))
    assert (T_BUILDING_MAP @ T_map_odom @ T_odom_base).difference(true)[0] < 0.15
    T = camera_pose((true.x_m, true.y_m, 0.7), true.yaw_rad, math.radians(-20))
    expected = building.robot_view(T, r.robot._settings.camera(), (0.5, 5.0), 1)
    shown = np.frombuffer(depth.data, "<u2").reshape(120, 160) / 1000.0
    assert np.mean(np.abs(shown - expected.depth_m) < 0.002) > 0.98
    assert np.mean(np.abs(np.reshape(color.data, (120, 160, 3)).astype(int) - expected.rgb) <= 2) > 0.98
    # tf_static holds the same camera
    mounting, optical = r.wait("tf_static")[0].transforms
    T_base_camera = _matrix(mounting.transform) @ _matrix(optical.transform)
    assert T_base_camera == pytest.approx(camera_pose((0.0, 0.0, 0.7), 0.0, math.radians(-20)), abs=1e-9)


def _matrix(transform: Any) -> np.ndarray:
    p, q = transform.translation, transform.rotation
    return Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)).matrix()


def test_a_goal_is_reached_and_another_canceled(rig):
    r = rig()
    wanted = r.goal_at(-1.0, 0.0, 1.0)
    goal = r.navigation.send(wanted, WAIT_S)
    until(lambda: goal.progress is not None, timeout_s=WAIT_S)
    assert 0 < goal.progress.distance_remaining_m < 3
    assert goal.wait(WAIT_S).status is GoalStatus.SUCCEEDED
    at = r.robot.robot.localisation.T_building_map @ PlanarTransform(wanted.x_m, wanted.y_m, wanted.yaw_rad)
    assert at.difference(r.robot.robot.pose)[0] < 0.3
    second = r.navigation.send(r.goal_at(2.0, 0.0), WAIT_S)
    until(lambda: r.robot.robot.speed_m_s > 0.1, timeout_s=WAIT_S)
    assert r.navigation.cancel(second, WAIT_S)
    assert second.wait(WAIT_S).status is GoalStatus.CANCELED
    until(lambda: r.robot.robot.speed_m_s == 0.0, timeout_s=WAIT_S)
    third = r.navigation.send(r.goal_at(0.5, 0.0), WAIT_S)
    fourth = r.navigation.send(r.goal_at(50.0, 0.0), WAIT_S)
    assert third.wait(WAIT_S).why == "navigate_to_pose ended the goal: aborted, a newer goal replaced it"
    assert "aborted, no path to (" in fourth.wait(WAIT_S).why
    lost = r.navigation.send(GoalPose("world", 0.0, 0.0, 0.0), WAIT_S)
    assert lost.wait(WAIT_S).why.endswith("aborted, there is no frame 'world'")


@pytest.mark.parametrize("stamped", [False, True])
def test_it_obeys_velocities_for_half_a_second(rig, stamped):
    r = rig(stamped_commands=stamped, namespace="/r7")
    type_name = "geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist"
    publisher = r.user.publisher("cmd_vel", type_name)
    zero = types.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    turn = types.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.8)
    twist = types.make("geometry_msgs/msg/Twist", linear=zero, angular=turn)
    if stamped:
        time_ = types.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        header = types.make("std_msgs/msg/Header", stamp=time_, frame_id="base_link")
        twist = types.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist)
    repeat_until(lambda: publisher.put(twist), lambda: r.robot.robot.turn_rate_rad_s == 0.8, timeout_s=WAIT_S)
    assert r.user.graph.endpoints("MS", "/r7/cmd_vel")[0].type_name == type_name
    until(lambda: r.robot.robot.turn_rate_rad_s == 0.0, timeout_s=WAIT_S)


def test_stamps_are_of_the_machines_clock_or_off_by_what_is_set(rig):
    for offset_s in (0.0, 3600.0):
        r = rig(clock_offset_s=offset_s)
        ages_s: list[float] = []

        def receive(message: RosMessage, ages_s: list[float] = ages_s) -> None:
            ages_s.append((message.received_ns - stamp_ns(message.data)) / 1e9)

        r.user.subscribe("odom", TYPES["odom"], receive)
        until(lambda: len(ages_s) >= 20, timeout_s=WAIT_S)  # noqa: B023
        assert -0.01 <= min(ages_s) + offset_s < 0.5


def test_pictures_are_made_only_while_somebody_looks(rig):
    r = rig()
    r.listen("odom")
    r.wait("odom", 20)
    assert r.robot.camera._count == 0
    r.listen("camera/color/image_raw")
    r.wait("camera/color/image_raw")
    assert r.robot.camera._count > 0


def test_compressed_pictures_are_what_image_transport_makes(rig):
    r = rig(compressed=True, depth_encoding="32FC1")
    color_topic, depth_topic = "camera/color/image_raw/compressed", "camera/depth/image_raw/compressedDepth"
    r.listen(color_topic, depth_topic)
    color, depth = r.wait(color_topic)[0], r.wait(depth_topic)[0]
    assert (color.format, depth.format) == ("rgb8; jpeg compressed bgr8", "32FC1; compressedDepth png")
    picture = cv2.imdecode(np.frombuffer(color.data, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (120, 160, 3)
    # decoded as the plugin does: https://github.com/ros-perception/image_transport_plugins
    a, b = np.frombuffer(depth.data[4:12].tobytes(), "<f4")
    quantised = cv2.imdecode(np.frombuffer(depth.data[12:], np.uint8), cv2.IMREAD_UNCHANGED)
    metres = np.where(quantised > 0, a / (quantised.astype(np.float64) - b), 0.0)
    raw = rig(depth_encoding="32FC1")
    raw.listen("camera/depth/image_raw")
    image = raw.wait("camera/depth/image_raw")[0]
    true = np.frombuffer(image.data, "<f4").reshape(120, 160)
    assert image.encoding == "32FC1"
    seen = np.isfinite(true)
    assert 0.2 < seen.mean() < 1.0
    assert np.abs(metres - true)[seen].max() < 0.01
    assert not metres[~seen].any()


def test_scan_battery_map_and_clock(rig, building):
    r = rig(publish_map=True, sim_time=True, clock_offset_s=3600.0)
    r.listen("scan", "battery_state", "odom")
    r.listen("/clock", type_name=TYPES["clock"])
    r.listen("map", qos=KEPT, type_name="nav_msgs/msg/OccupancyGrid")
    scan = r.wait("scan")[0]
    ranges = np.asarray(scan.ranges)
    assert len(ranges) == 360
    assert scan.angle_min == pytest.approx(-math.pi)
    here, navigation = r.robot.robot.state, building.navigation.floors["0"]
    nearest = int(np.argmin(ranges))
    angle = here.yaw_rad + scan.angle_min + nearest * scan.angle_increment
    p = here.x_m + (ranges[nearest] + 0.02) * math.cos(angle), here.y_m + (ranges[nearest] + 0.02) * math.sin(angle)
    row, col = navigation.grid.cells_of(p)
    assert navigation.obstacle[row - 1 : row + 2, col - 1 : col + 2].any()
    assert 0.99 < r.wait("battery_state")[0].percentage <= 1.0
    assert 3600 <= r.wait("odom")[0].header.stamp.sec < 3700
    assert 3600 <= r.wait("/clock")[0].clock.sec < 3700
    grid = r.wait("map")[0]
    cells = np.asarray(grid.data).reshape(grid.info.height, grid.info.width)
    origin = grid.info.origin
    T_map_cells = PlanarTransform(
        origin.position.x, origin.position.y, 2 * math.atan2(origin.orientation.z, origin.orientation.w)
    )
    row, col = np.argwhere(cells == 100)[0]
    place = T_BUILDING_MAP @ T_map_cells @ PlanarTransform(*(np.array([col, row]) + 0.5) * grid.info.resolution)
    assert navigation.obstacle[tuple(navigation.grid.cells_of((place.x_m, place.y_m)))]
    assert {-1, 0, 100} == set(np.unique(cells))


# --- faults -------------------------------------------------------------------------------------------------------


def test_it_rejects_goals(rig):
    r = rig(faults=["goal_rejected"])
    with pytest.raises(RosError, match="rejects the goal"):
        r.navigation.send(r.goal_at(-1.0, 0.0), WAIT_S)


@pytest.mark.parametrize(
    ("fault", "why"),
    [("goal_aborted", "a fault that was asked for"), ("localisation_lost", "has lost its localisation")],
)
def test_it_aborts_goals(rig, fault, why):
    r = rig(faults=[fault], fault_after_s=0.5)
    goal = r.navigation.send(r.goal_at(-2.0, 0.0), WAIT_S)
    assert why in goal.wait(WAIT_S).why


def test_feedback_stops_and_the_goal_goes_on(rig):
    r = rig(faults=["feedback_stops"], fault_after_s=0.5)
    goal = r.navigation.send(r.goal_at(-2.0, 0.0), WAIT_S)
    assert goal.wait(WAIT_S).status is GoalStatus.SUCCEEDED
    assert goal.progress is None or goal.progress.distance_remaining_m > 1.0


def test_no_tf_and_no_depth(rig):
    r = rig(faults=["no_tf", "no_depth"])
    r.listen("tf", "odom", "camera/color/image_raw", "camera/depth/image_raw")
    r.wait("odom", 20)
    r.wait("camera/color/image_raw", 2)
    assert (r.heard["tf"], r.heard["camera/depth/image_raw"]) == ([], [])


def test_depth_in_millimetres_that_is_called_metres(rig):
    r = rig(faults=["depth_mm_as_metres"])
    r.listen("camera/depth/image_raw")
    image = r.wait("camera/depth/image_raw")[0]
    assert image.encoding == "32FC1"
    assert 500 < np.frombuffer(image.data, "<f4").max() <= 5000


def test_its_localisation_jumps_and_its_odometry_restarts(rig):
    r = rig(drift=0.0, localisation_sigma_m=0.0, localisation_sigma_deg=0.0)
    r.robot.jump()
    off_m = (r.robot.robot.localisation.T_building_map @ r.robot.robot.localisation.pose).difference(
        r.robot.robot.pose
    )[0]
    assert off_m == pytest.approx(0.5)
    r.robot.restart_odometry()
    assert r.robot.robot.localisation.T_odom_base == PlanarTransform()
    assert r.robot.robot.localisation.T_building_map == r.robot.robot.pose


@pytest.mark.slow
def test_as_a_process_it_serves_its_user_and_dies_in_mid_goal(router, home_cache):
    environment = {
        **os.environ,
        "SURVEILNAV_CACHE_DIR": str(home_cache),
        "SURVEILNAV_SIM__BUILDING": "parametric_flat",
        "SURVEILNAV_SIM__LIGHTING": "flat",
        "SURVEILNAV_ROBOT_HARDWARE__ROUTER": router,
        "SURVEILNAV_ROBOT_HARDWARE__DOMAIN": "201",
        "SURVEILNAV_ROBOT_HARDWARE__START": "5,4,0,0",
        "SURVEILNAV_ROBOT_HARDWARE__FAULTS": '["node_dies"]',
        "SURVEILNAV_ROBOT_HARDWARE__FAULT_AFTER_S": "1",
    }
    command = [sys.executable, "-m", "surveilnav.simulator.hardware.ros2_robot"]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "the robot is ready\n"
        with RosSession("user", router=router, domain=201) as user:
            told: list[Any] = []
            user.subscribe("tf", TYPES["tf"], lambda m: told.append(m.data))
            until(lambda: transforms(told, "map"), timeout_s=WAIT_S)
            process.send_signal(signal.SIGUSR1)
            until(lambda: _jumped(transforms(told, "map")), timeout_s=WAIT_S)
            goal = NavigateToPose(user).send(GoalPose("map", 3.0, 4.0, 0.0), WAIT_S)
            assert process.wait(WAIT_S) == 1
            until(lambda: not user.graph.endpoints("MP", "/odom"), timeout_s=WAIT_S)
            assert goal.wait(WAIT_S).status is GoalStatus.UNKNOWN
    finally:
        process.kill()
        process.wait()


def _jumped(known: dict[int, Any]) -> bool:
    return planar(known[min(known)]).difference(planar(known[max(known)]))[0] > 0.3
