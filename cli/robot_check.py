"""Listens to a real robot for some seconds, and says of each part whether it is as needed, and what to do if it isn't."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from surveilnav.robot_file import RobotFile
from surveilnav.ros2.names import qualified
from surveilnav.ros2.session import RosError, RosMessage, RosSession
from surveilnav.services.robot_node.bodies.ros2.body import Ros2Body
from surveilnav.services.robot_node.bodies.ros2.camera import stamp_of
from surveilnav.services.robot_node.bodies.ros2.transforms import TransformError

#: Fewer messages a second are too few: a robot at 0.5 m/s has then moved on by more than the maps' cells.
_LEAST_HZ = {"odometry": 5.0, "colour": 0.5, "depth": 0.5, "camera_info": 0.2}
_CLOCK_OFF_S = 5.0


@dataclass(frozen=True, slots=True)
class PartCheck:
    """The check of one part of a robot. ``message``: what is there or, if it isn't ``ok``, what to do."""

    part: str
    ok: bool
    message: str


class _Count:
    """How often a topic's messages come, and how their stamps compare with this machine's clock."""

    def __init__(self) -> None:
        self.times_s: list[float] = []
        self.off_s = 0.0

    def __call__(self, message: RosMessage) -> None:
        self.times_s.append(time.monotonic())
        self.off_s = stamp_of(message.data.header) / 1e9 - message.received_ns / 1e9

    @property
    def hz(self) -> float:
        return (len(self.times_s) - 1) / (self.times_s[-1] - self.times_s[0]) if len(self.times_s) > 1 else 0.0


def check_robot(
    file: RobotFile, seconds: float, fault_of: Callable[[float, float], str] = lambda x, y: ""
) -> list[PartCheck]:
    """Connects to the robot's router and listens.

    Args:
        fault_of: says of a place (x, y) [m] in the building why the robot can't be there; empty: it can.
    """
    try:
        with RosSession(
            "surveilnav_check", router=file.router, domain=file.domain, namespace=file.namespace
        ) as session:
            counts = _count(file, session)
            body = Ros2Body(file, session)
            time.sleep(seconds)
            try:
                return [
                    PartCheck("router", True, f"reached at {file.router}, domain {file.domain}"),
                    *_topics(file, session, counts),
                    _clock(counts),
                    *_place(file, body, fault_of),
                    *_nav2(file, session),
                ]
            finally:
                body.close()
    except RosError as error:
        what = (
            "is rmw_zenohd running there (ros2 run rmw_zenoh_cpp rmw_zenohd), and does a firewall let its port through?"
        )
        return [PartCheck("router", False, f"{error}: {what}")]


def _count(file: RobotFile, session: RosSession) -> dict[str, tuple[str, str, _Count]]:
    """By part, the topic, its type, and a counter that is subscribed to it."""
    topics = file.topics
    image = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
    parts = {
        "odometry": (topics.odometry, "nav_msgs/msg/Odometry"),
        "colour": (topics.image, image[not topics.image.endswith("/compressed")]),
        "depth": (topics.depth, image[not topics.depth.endswith("/compressedDepth")]),
        "camera_info": (topics.camera_info, "sensor_msgs/msg/CameraInfo"),
    }
    counts = {part: (topic, kind, _Count()) for part, (topic, kind) in parts.items()}
    for topic, kind, count in counts.values():
        session.subscribe(topic, kind, count)
    return counts


def _topics(file: RobotFile, session: RosSession, counts: dict[str, tuple[str, str, _Count]]) -> list[PartCheck]:
    found = []
    for part, (topic, kind, count) in counts.items():
        name = qualified(topic, file.namespace)
        publishers = session.graph.endpoints("MP", name)
        if not publishers:
            near = sorted({e.name for e in session.graph.entities() if e.kind == "MP" and e.type_name == kind})
            have = f"; of this type there are {', '.join(near[:6])}" if near else ""
            found.append(
                PartCheck(part, False, f"nobody publishes {name}{have}. Set topics.{_entry(part)} in the file")
            )
        elif publishers[0].type_name != kind:
            found.append(PartCheck(part, False, f"{name} has the type {publishers[0].type_name}, expected {kind}"))
        elif count.hz < _LEAST_HZ[part]:
            message = f"{name} comes {count.hz:.1f} times a second, expected {_LEAST_HZ[part]:g} or more"
            found.append(PartCheck(part, False, message))
        else:
            found.append(PartCheck(part, True, f"{name}, {count.hz:.1f} a second"))
    return found


def _entry(part: str) -> str:
    return "image" if part == "colour" else part


def _clock(counts: dict[str, tuple[str, str, _Count]]) -> PartCheck:
    """Stamps are compared with each other only, so another clock does no harm; people should know of it."""
    count = counts["odometry"][2]
    if not count.times_s:
        return PartCheck("clock", True, "not known: no odometry came")
    off_s = count.off_s
    if abs(off_s) < _CLOCK_OFF_S:
        return PartCheck("clock", True, f"within {abs(off_s):.1f} s of this machine's")
    return PartCheck(
        "clock", True, f"{abs(off_s):.0f} s {'ahead of' if off_s > 0 else 'behind'} this machine's; that works"
    )


def _place(file: RobotFile, body: Ros2Body, fault_of: Callable[[float, float], str]) -> list[PartCheck]:
    camera = body.camera_problem()
    found = [PartCheck("pictures", not camera, camera or "colour and depth belong together, and can be read")]
    if problem := body.place.problem():
        return [*found, PartCheck("place", False, problem)]
    try:
        at = body.place.base_in_building()
    except TransformError as error:
        return [*found, PartCheck("place", False, str(error))]
    where = (
        f"the robot is at ({at.x_m:.2f}, {at.y_m:.2f}) m, {math.degrees(at.yaw_rad):.0f} degrees, on floor {file.floor}"
    )
    height_m = body.description.camera_height_m
    fault = fault_of(at.x_m, at.y_m)
    asked = "is that so? If not, measure T_building_map (surveilnav robots frame)"
    return [
        *found,
        PartCheck("place", not fault, f"{where}: {fault or asked}"),
        PartCheck("camera", True, f"{height_m:.2f} m above its base"),
    ]


def _nav2(file: RobotFile, session: RosSession) -> list[PartCheck]:
    if file.drive == "actions":
        name = qualified(file.topics.velocity, file.namespace)
        listens = bool(session.graph.endpoints("MS", name))
        return [PartCheck("velocity", listens, name if listens else f"nobody listens to {name}")]
    name = qualified(f"{file.topics.navigate_to_pose}/_action/send_goal", file.namespace)
    if session.graph.endpoints("SS", name):
        return [PartCheck("Nav2", True, f"serves {file.topics.navigate_to_pose}")]
    return [
        PartCheck(
            "Nav2", False, f"nobody serves {name}. Is Nav2 active (ros2 action list)? Without it: `drive: actions`"
        )
    ]
