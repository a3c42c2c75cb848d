"""``python -m surveilnav.simulator.hardware.ros2_robot``: a simulated robot with ROS 2 and Nav2, on the wire of rmw_zenoh.

It moves in real time, in steps of 50 ms. All that it publishes is stamped with the step at which it was so; a picture, with the
step at whose pose it was rendered. ``ground_truth`` is simulation only: for a judge, for nobody who navigates.
"""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from surveilnav.bus.main import run_service
from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_state import RobotState
from surveilnav.ros2.names import Qos
from surveilnav.ros2.navigate_to_pose import GoalPose, GoalStatus, NavigateToPoseServer
from surveilnav.ros2.session import RosMessage, RosSession
from surveilnav.simulator.hardware import ros_messages as ros
from surveilnav.simulator.hardware.camera import FRAME, RobotCamera
from surveilnav.simulator.hardware.config import RobotHardwareSettings
from surveilnav.simulator.hardware.faults import Faults
from surveilnav.simulator.hardware.lidar import RANGE_M, Lidar
from surveilnav.simulator.robot_start import start_state
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.continuous_robot import ContinuousRobot
from surveilnav.simulator.world.simulated_nav2 import NavigationGoal, SimulatedNav2

STEP_S = 0.05
#: Every how many steps each of these is published.
_MAP_ODOM_STEPS, _FEEDBACK_STEPS, _SCAN_STEPS, _BATTERY_STEPS, _HEALTH_STEPS = 2, 4, 4, 20, 20
_KEPT = Qos(transient_local=True, depth=1)
#: A robot that was stopped for longer (a suspended process) doesn't make up for it.
_MAX_BEHIND_S = 1.0
#: The battery lasts this long.
_BATTERY_S = 8 * 3600.0


class Ros2Robot:
    """The robot's node. ``step`` is called every 50 ms."""

    def __init__(self, session: RosSession, building: SimulatedBuilding, settings: RobotHardwareSettings) -> None:
        self._settings, self._faults = settings, Faults(settings.faults, settings.fault_after_s)
        start = start_state(building, settings.start, settings.start_for)
        self.robot = ContinuousRobot(
            building.navigation,
            replace(start, pitch_rad=math.radians(settings.camera_tilt_deg)),
            limits=settings.limits(),
            localisation=settings.localisation(),
            seed=building.settings.seed,
        )
        self.nav2 = SimulatedNav2(self.robot)
        self._lock = threading.RLock()
        self._goals: dict[bytes, NavigationGoal] = {}
        self._started_ns, self._steps = time.time_ns(), 0
        ground = building.navigation.floors[start.floor]
        self._ground, self._lidar = ground, Lidar(building.scene, ground.grid, ground.z_m)
        self._latest = self._stamp_ns(), self.robot.state
        self._announce(session)
        self.camera = RobotCamera(session, building, settings, self._faults, self.latest)

    def latest(self) -> tuple[int, RobotState]:
        """The newest step's stamp, and where the robot then was in truth."""
        return self._latest

    def start_clock(self) -> None:
        """Has the robot's time begin now: what is made only once may have taken seconds."""
        self._started_ns = time.time_ns()

    def step(self) -> None:
        """Moves the robot on by 50 ms, and publishes what is due."""
        with self._lock:
            self.nav2.advance(STEP_S)
            self._steps += 1
            self._latest = self._stamp_ns(), self.robot.state
            if self.nav2.goal is not None and self.nav2.goal.status == "executing":
                self._faults.apply(self.nav2, self.nav2.goal)
            self._publish()
            self._report_goals()

    def skip(self, steps: int) -> None:
        """Lets time pass in which the robot didn't move."""
        self._steps += steps

    def jump(self) -> None:
        """Has the localisation jump, by ``jump_m``."""
        with self._lock:
            self.robot.jump(self._settings.jump_m, 0.0)

    def restart_odometry(self) -> None:
        """Has odometry, and with ``restart_new_map`` the map, begin anew where the robot is."""
        with self._lock:
            self.robot.restart_odometry(new_map=self._settings.restart_new_map)
            self._publish_map()

    def _stamp_ns(self) -> int:
        begun_ns = 0 if self._settings.sim_time else self._started_ns
        return begun_ns + round((self._steps * STEP_S + self._settings.clock_offset_s) * 1e9)

    # --- out ------------------------------------------------------------------------------------------------------

    def _announce(self, session: RosSession) -> None:
        """Declares what the robot publishes, subscribes to and serves."""
        self._odom = session.publisher("odom", "nav_msgs/msg/Odometry")
        self._tf = session.publisher("tf", "tf2_msgs/msg/TFMessage", Qos(depth=100))
        self._tf_static = session.publisher(
            "tf_static", "tf2_msgs/msg/TFMessage", Qos() if self._faults.tf_static_volatile else _KEPT
        )
        self._scan = session.publisher("scan", "sensor_msgs/msg/LaserScan", Qos(reliable=False, depth=5))
        self._battery = session.publisher("battery_state", "sensor_msgs/msg/BatteryState")
        self._truth = session.publisher("ground_truth", "nav_msgs/msg/Odometry")
        self._map = (
            session.publisher("map", "nav_msgs/msg/OccupancyGrid", _KEPT) if self._settings.publish_map else None
        )
        self._clock = session.publisher("/clock", "rosgraph_msgs/msg/Clock") if self._settings.sim_time else None
        if not self._faults.no_tf:
            self._tf_static.put(self._camera_frames())
        self._publish_map()
        command = "geometry_msgs/msg/TwistStamped" if self._settings.stamped_commands else "geometry_msgs/msg/Twist"
        session.subscribe("cmd_vel", command, self._on_command)
        self._server = NavigateToPoseServer(session, self._accept, self._cancel)

    def _camera_frames(self) -> Any:
        """The camera in the robot: its height and tilt, and the frame of its pictures."""
        stamp_ns, settings = self._stamp_ns(), self._settings
        tilt = ros.tilted(math.radians(settings.camera_tilt_deg))
        return ros.tf(
            ros.transform(stamp_ns, "base_link", "camera_link", (0.0, 0.0, settings.camera_height_m), tilt),
            ros.transform(stamp_ns, "camera_link", FRAME, (0.0, 0.0, 0.0), ros.OPTICAL),
        )

    def _publish(self) -> None:
        (stamp_ns, state), robot, steps = self._latest, self.robot, self._steps
        estimate, velocity = robot.localisation, (robot.speed_m_s, robot.turn_rate_rad_s)
        self._odom.put(ros.odometry(stamp_ns, "odom", "base_link", estimate.T_odom_base, *velocity))
        self._truth.put(ros.odometry(stamp_ns, f"building/{state.floor}", "base_link", robot.pose, *velocity))
        if not self._faults.no_tf:
            transforms = [ros.planar_transform(stamp_ns, "odom", "base_link", estimate.T_odom_base)]
            if steps % _MAP_ODOM_STEPS == 0 and not estimate.lost:
                transforms.append(ros.planar_transform(stamp_ns, "map", "odom", estimate.T_map_odom))
            self._tf.put(ros.tf(*transforms))
        if steps % _SCAN_STEPS == 0:
            period_s = _SCAN_STEPS * STEP_S
            self._scan.put(ros.laser_scan(stamp_ns, "base_link", self._lidar.scan(state), RANGE_M, period_s))
        if steps % _BATTERY_STEPS == 0:
            self._battery.put(ros.battery(stamp_ns, max(0.0, 1.0 - robot.time_s / _BATTERY_S)))
        if self._clock is not None:
            self._clock.put(ros.clock(stamp_ns))

    def _publish_map(self) -> None:
        """The floor as a map server has it: what is under a roof is known."""
        if self._map is None:
            return
        ground = self._ground
        cells = np.where(ground.obstacle, 100, np.where(ground.supported & ground.indoor, 0, -1)).astype(np.int8)
        T_map_building = self.robot.localisation.T_building_map.inverse()
        self._map.put(ros.occupancy_grid(self._stamp_ns(), cells, ground.grid, T_map_building))

    # --- goals and commands ---------------------------------------------------------------------------------------

    def _on_command(self, message: RosMessage) -> None:
        twist = message.data.twist if self._settings.stamped_commands else message.data
        with self._lock:
            self.robot.override(twist.linear.x, twist.angular.z)

    def _accept(self, id: bytes, pose: GoalPose) -> bool:
        """Starts to drive to a pose; one in another frame than ``map`` and ``odom`` is aborted at once, as Nav2 does."""
        if self._faults.rejects_goals:
            return False
        with self._lock:
            wanted = PlanarTransform(pose.x_m, pose.y_m, pose.yaw_rad)
            if pose.frame == "odom":
                wanted = self.robot.localisation.T_map_odom @ wanted
            self._goals[id] = self.nav2.send(wanted)
            if pose.frame not in ("map", "odom"):
                self.nav2.abort(self._goals[id], f"there is no frame {pose.frame!r}")
        return True

    def _cancel(self, id: bytes) -> bool:
        with self._lock:
            return id in self._goals and self.nav2.cancel(self._goals[id])

    def _report_goals(self) -> None:
        """Feedback on the goal that is driven to, and the results of those that have ended."""
        for id, goal in list(self._goals.items()):
            if goal.status != "executing":
                del self._goals[id]
                self._server.end(id, GoalStatus[goal.status.upper()], goal.why)
            elif self._steps % _FEEDBACK_STEPS == 0 and not self._faults.withholds_feedback(goal):
                at = self.robot.localisation.pose
                here = GoalPose("map", at.x_m, at.y_m, at.yaw_rad)
                self._server.tell_progress(id, here, goal.distance_remaining_m, goal.recoveries, goal.elapsed_s)


def run(robot: Ros2Robot, ended: threading.Event, health_file: Path | None = None) -> None:
    """Moves a robot in real time until ``ended`` is set. ``health_file`` is touched each second."""
    robot.start_clock()
    begun_s, steps = time.monotonic(), 0
    with robot.camera:
        while True:
            behind_s = time.monotonic() - begun_s - (steps + 1) * STEP_S
            if behind_s < 0 and ended.wait(-behind_s):
                return
            if behind_s > _MAX_BEHIND_S:
                missed = int(behind_s / STEP_S)
                robot.skip(missed)
                steps += missed
            if ended.is_set():
                return
            robot.step()
            steps += 1
            if health_file is not None and steps % _HEALTH_STEPS == 0:
                health_file.touch()


def main() -> None:
    """Runs one simulated robot until SIGTERM. SIGUSR1: its localisation jumps. SIGUSR2: its odometry begins anew."""
    settings = RobotHardwareSettings()
    building = SimulatedBuilding(SimulationSettings())
    _ = building.renderer  # loads it now: the first picture then doesn't wait for it
    with RosSession(
        "simulated_robot", router=settings.router, domain=settings.domain, namespace=settings.namespace
    ) as session:
        robot = Ros2Robot(session, building, settings)
        signal.signal(signal.SIGUSR1, lambda *_: robot.jump())
        signal.signal(signal.SIGUSR2, lambda *_: robot.restart_odometry())
        print("the robot is ready", flush=True)
        run(robot, threading.Event(), settings.health_file)


if __name__ == "__main__":
    sys.exit(run_service(main))
