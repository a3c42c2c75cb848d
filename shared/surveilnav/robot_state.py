"""The state of a robot, as its body reports it: pose, progress of the mission, outcome of the last action."""

from __future__ import annotations

from dataclasses import dataclass, replace

from surveilnav.geometry import Matrix4, base_pose, camera_pose
from surveilnav.robot_body import CAMERA_HEIGHT_M


@dataclass(frozen=True, slots=True)
class RobotState:
    """Where a robot is and how it got there.

    Attributes:
        x_m, y_m, z_m: position of its base on the floor, in the world frame.
        floor: id of that floor.
        yaw_rad: heading, anticlockwise from the world's +x axis, in (-pi, pi].
        pitch_rad: tilt of the camera, positive upwards.
        seq: sequence number of the observation, one more after each action.
        steps: actions since the mission began; a stair counts as many as moves of its length would.
        path_m: distance travelled since the mission began.
        collided: whether the last move was cut short.
        stopped: whether the last action was ``stop``.
        last_action: the action that led to this state; None before the first one of a mission.
        mission: id of the mission whose command was carried out last.
    """

    x_m: float
    y_m: float
    z_m: float
    floor: str
    yaw_rad: float
    pitch_rad: float = 0.0
    seq: int = 0
    steps: int = 0
    path_m: float = 0.0
    collided: bool = False
    stopped: bool = False
    last_action: str | None = None
    mission: str = ""

    @property
    def p_world(self) -> tuple[float, float, float]:
        """Position (x, y, z) of the base [m, world]."""
        return self.x_m, self.y_m, self.z_m

    def base_pose(self) -> Matrix4:
        """``T_world_base`` (4, 4): x forward, y left, z up, origin on the floor."""
        return base_pose(self.p_world, self.yaw_rad)

    def camera_pose(self, camera_height_m: float = CAMERA_HEIGHT_M) -> Matrix4:
        """``T_world_camera`` (4, 4) of a camera ``camera_height_m`` above the centre of the base."""
        return camera_pose((self.x_m, self.y_m, self.z_m + camera_height_m), self.yaw_rad, self.pitch_rad)

    def begin_mission(self, mission: str) -> RobotState:
        """The same pose at the start of a mission: path and steps count from zero, ``seq`` goes on."""
        return replace(self, path_m=0.0, steps=0, collided=False, stopped=False, last_action=None, mission=mission)
