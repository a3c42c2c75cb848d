"""A real robot by ROS 2, as the robot node uses it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from surveilnav.messages import RobotDescription, Stair, WaypointPose, WaypointStatus
from surveilnav.robot_body import CAMERA_HEIGHT_M, HFOV_RAD
from surveilnav.robot_file import RobotFile
from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_state import RobotState
from surveilnav.ros2.names import Qos, qualified
from surveilnav.ros2.navigate_to_pose import NavigateToPose
from surveilnav.ros2.session import RosMessage, RosSession
from surveilnav.services.robot_node.bodies.body import Observation
from surveilnav.services.robot_node.bodies.ros2.battery import Battery
from surveilnav.services.robot_node.bodies.ros2.camera import RobotCamera, stamp_of
from surveilnav.services.robot_node.bodies.ros2.place import RobotPlace
from surveilnav.services.robot_node.bodies.ros2.transforms import TransformBuffer, TransformError
from surveilnav.services.robot_node.bodies.ros2.velocity import Velocity, VelocityDrive
from surveilnav.services.robot_node.bodies.ros2.waypoint import WaypointDrive

#: A problem that is over sooner isn't worth stopping for: a transform or a picture may be late now and then.
_PATIENCE_S = 3.0
#: How long an observation after an action waits for a picture that was taken after it.
_PICTURE_TIMEOUT_S = 5.0
_POLL_S = 0.02
_WATCH_S = 0.2
#: A clock that differs by less isn't worth a word.
_CLOCK_OFF_S = 2.0
_STANDING_M_S, _STANDING_RAD_S = 0.02, 0.05
_SENSOR_QOS = Qos(reliable=False, depth=5)
_STATIC_QOS = Qos(transient_local=True, depth=100)


class Ros2Body:
    """A ``Body``: its pictures, transforms and odometry come from ROS 2; it drives by Nav2, or by velocities.

    Its description, camera height and angle of view among it, comes from its file, its transforms and its camera_info.
    """

    stairs: Sequence[Stair] = ()

    def __init__(self, file: RobotFile, session: RosSession) -> None:
        self._file = file
        self._transforms = TransformBuffer()
        self.place, self._camera = RobotPlace(file, self._transforms), RobotCamera()
        self._lock = threading.Lock()
        self._state = RobotState(0.0, 0.0, file.floor_z_m, file.floor, 0.0)
        self._path_before_m = 0.0
        self._shown_ns = 0  # the newest pair that was shown
        self._acted_ns = 0  # by the robot's clock, when the last action ended
        self._problem, self._problem_since_s = "", time.monotonic()
        self._battery, self._clock_off_s = Battery(), 0.0
        self._closing = threading.Event()
        self._session = session
        self._subscribe(session)
        topics = file.topics
        kind = "geometry_msgs/msg/TwistStamped" if topics.velocity_stamped else "geometry_msgs/msg/Twist"
        velocities = session.publisher(topics.velocity, kind)
        self._velocity = VelocityDrive(velocities, topics.velocity_stamped, self._base_by_odometry)
        self._drive = None
        if file.drive == "waypoints":
            nav2 = NavigateToPose(session, topics.navigate_to_pose)
            self._drive = WaypointDrive(nav2, file.frames.map, self.place.to_map)
        threading.Thread(target=self._watch, name="ros2-watch", daemon=True).start()

    def _subscribe(self, session: RosSession) -> None:
        topics, place, camera = self._file.topics, self.place, self._camera
        image = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
        session.subscribe(topics.tf, "tf2_msgs/msg/TFMessage", lambda m: place.add_transforms(m.data, static=False))
        session.subscribe(
            topics.tf_static, "tf2_msgs/msg/TFMessage", lambda m: place.add_transforms(m.data, static=True), _STATIC_QOS
        )
        session.subscribe(topics.odometry, "nav_msgs/msg/Odometry", self._on_odometry, _SENSOR_QOS)
        if topics.localisation:
            session.subscribe(
                topics.localisation,
                "geometry_msgs/msg/PoseWithCovarianceStamped",
                lambda m: place.add_localisation(m.data),
            )
        session.subscribe(
            topics.image,
            image[not topics.image.endswith("/compressed")],
            lambda m: camera.add_colour(m.data),
            _SENSOR_QOS,
        )
        session.subscribe(
            topics.depth,
            image[not topics.depth.endswith("/compressedDepth")],
            lambda m: camera.add_depth(m.data),
            _SENSOR_QOS,
        )
        if topics.battery:
            session.subscribe(
                topics.battery, "sensor_msgs/msg/BatteryState", lambda m: self._battery.add(m.data), _SENSOR_QOS
            )
        session.subscribe(
            topics.camera_info, "sensor_msgs/msg/CameraInfo", lambda m: camera.set_info(m.data), _SENSOR_QOS
        )

    def _on_odometry(self, message: RosMessage) -> None:
        self._clock_off_s = (stamp_of(message.data.header) - message.received_ns) / 1e9
        self.place.add_odometry(message.data, message.attachment.gid if message.attachment else b"")

    # --- what the node asks ---------------------------------------------------------------------------------------

    @property
    def description(self) -> RobotDescription:
        """From its file; height and angle of view of its camera as soon as it has told them."""
        file = self._file
        return RobotDescription(
            drive=file.drive,
            radius_m=file.body.radius_m,
            height_m=file.body.height_m,
            camera_height_m=self._camera_height_m(),
            hfov_rad=self._camera.hfov_rad or HFOV_RAD,
            max_pitch_rad=0.0,
        )

    @property
    def notes(self) -> Sequence[str]:
        off_s = self._clock_off_s
        if abs(off_s) < _CLOCK_OFF_S:
            return self.place.notes
        side = "ahead of" if off_s > 0 else "behind"
        return [*self.place.notes, f"its clock is {abs(off_s):.0f} s {side} this machine's; that does no harm"]

    @property
    def battery(self) -> float | None:
        """How full its battery is, 0 to 1; None: it doesn't say."""
        return self._battery.share

    @property
    def problem(self) -> str:
        """Why it can't be used, once that has lasted for a while."""
        return self._problem if time.monotonic() - self._problem_since_s >= _PATIENCE_S else ""

    def camera_problem(self) -> str:
        """Why its pictures can't be used, for people; empty if they can, as far as is known."""
        return self._camera.missing() or self._camera.problem

    def _watch(self) -> None:
        """Looks now and then whether something is wrong."""
        while not self._closing.wait(_WATCH_S):
            self.place.record_corrections()
            why = self.place.problem() or self.camera_problem() or self._camera_place_problem()
            if bool(why) != bool(self._problem):
                self._problem_since_s = time.monotonic()
            self._problem = why

    def _camera_place_problem(self) -> str:
        """Why it isn't known where its camera is on it; empty if it is, or if there is no picture yet."""
        try:
            self.place.camera_on_base(self._camera.frame)
        except TransformError as error:
            name = qualified(self._file.topics.tf_static, self._session.namespace)
            publishers = self._session.graph.endpoints("MP", name)
            if publishers and not any(p.qos.transient_local for p in publishers):
                return (
                    f"{error} {name} is published as volatile, so what was said before SurveilNav listened is lost: its "
                    "publisher has to be transient_local"
                )
            return str(error)
        return ""

    @property
    def waypoint(self) -> WaypointStatus | None:
        return self._drive.status if self._drive is not None else None

    @property
    def state(self) -> RobotState:
        """Where it is now, and the number of its newest observation."""
        with self._lock:
            state = self._state
        try:
            return self._at(state, self.place.base_in_building())
        except TransformError:
            return state

    def refusal(self, action: str, to_floor: str | None = None) -> str:
        """Why it can't carry out an action at all, as a sentence for people; empty if it can."""
        drives = {"waypoints": ("drive_to", "stop"), "actions": ("move_forward", "turn_left", "turn_right", "stop")}
        can = drives[self._file.drive]
        return "" if action in can else f"this robot can't {action!r:.40}; it can {', '.join(can)}"

    # --- what the node commands -----------------------------------------------------------------------------------

    def begin_mission(self, mission: str) -> None:
        """Starts to count path and steps for a mission."""
        if self._drive is not None:
            self._drive.forget()
        with self._lock:
            self._path_before_m = self.place.path_m
            self._state = self._state.begin_mission(mission)

    def drive_to(self, waypoint: WaypointPose | None) -> None:
        """Begins to drive to a waypoint by Nav2, and returns at once."""
        if self._drive is None:
            return
        self._drive.drive_to(waypoint)
        with self._lock:
            self._state = replace(self._state, stopped=False, last_action="drive_to")

    def act(self, action: str, to_floor: str | None = None) -> None:
        """``stop``, or a discrete action by velocities; returns when the robot has come to rest."""
        if action == "stop":
            self._come_to_rest()
        done = action == "stop" or self._velocity.act(action)
        with self._lock:
            self._acted_ns = self._transforms.newest_ns(self._file.frames.base) or 0
            self._state = replace(
                self._state,
                seq=self._state.seq + 1,
                steps=self._state.steps + 1,
                collided=not done,
                stopped=action == "stop",
                last_action=action,
            )

    def halt(self) -> None:
        """Cancels the goal, and sends a velocity of zero until odometry says that the robot stands."""
        self._come_to_rest()

    def _come_to_rest(self) -> None:
        if self._drive is not None:
            self._drive.drive_to(None)
        until_s = time.monotonic() + 2.0
        self._velocity.halt()
        while not self.is_standing and time.monotonic() < until_s:
            time.sleep(_POLL_S)
            self._velocity.put(Velocity())

    @property
    def is_standing(self) -> bool:
        """Whether odometry says that it stands still."""
        return self.place.speed_m_s < _STANDING_M_S and self.place.turn_rad_s < _STANDING_RAD_S

    def close(self) -> None:
        """Ends its drive."""
        self._closing.set()
        if self._drive is not None:
            self._drive.close()

    # --- what it sees ---------------------------------------------------------------------------------------------

    def observe(self) -> Observation | None:
        """The newest pair of pictures whose place is known, if it is newer than the one before.

        After an action by velocities it waits for a picture that was taken afterwards.
        """
        until_s = time.monotonic() + (_PICTURE_TIMEOUT_S if self._file.drive == "actions" else 0.0)
        while True:
            if (observed := self._newest()) is not None or time.monotonic() >= until_s:
                return observed
            time.sleep(_POLL_S)

    def _newest(self) -> Observation | None:
        if self.place.problem():
            return None
        for stamp_ns in self._camera.stamps():
            if stamp_ns <= max(self._shown_ns, self._acted_ns) and self._shown_ns - stamp_ns < 10**10:
                return None
            try:
                T_world_base = self.place.base_in_building(stamp_ns)
                T_world_camera = self.place.camera_in_building(self._camera.frame, stamp_ns)
            except TransformError:
                continue  # its transform may still come; an older picture may have one
            pair = self._camera.pair(stamp_ns)
            if pair is None:
                return None
            self._shown_ns = stamp_ns
            with self._lock:
                if self._file.drive == "waypoints":
                    self._state = replace(self._state, seq=self._state.seq + 1)
                state = self._at(self._state, T_world_base)
            height_m = float(T_world_camera[2, 3]) - self._file.floor_z_m
            return Observation(
                state, T_world_camera, pair.camera, height_m, self._file.depth_range_m, pair.rgb, pair.depth_m
            )
        return None

    def _at(self, state: RobotState, T_world_base: PlanarTransform) -> RobotState:
        path_m = max(0.0, self.place.path_m - self._path_before_m)
        return replace(state, x_m=T_world_base.x_m, y_m=T_world_base.y_m, yaw_rad=T_world_base.yaw_rad, path_m=path_m)

    def _base_by_odometry(self) -> PlanarTransform:
        return PlanarTransform.from_matrix(self._transforms.lookup(self._file.frames.odom, self._file.frames.base))

    def _camera_height_m(self) -> float:
        try:
            height_m = float(self.place.camera_on_base(self._camera.frame)[2, 3])
        except TransformError:
            return CAMERA_HEIGHT_M
        return height_m if 0.0 < height_m < 4.0 and math.isfinite(height_m) else CAMERA_HEIGHT_M
