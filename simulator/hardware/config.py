"""Settings of simulated hardware: ``SURVEILNAV_ROBOT_HARDWARE__<FIELD>`` and ``SURVEILNAV_CAMERA_HARDWARE__<FIELD>``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.geometry import Pinhole
from surveilnav.robot_body import CAMERA_HEIGHT_M, DEPTH_RANGE_M
from surveilnav.robot_frame import PlanarTransform
from surveilnav.simulator.hardware.faults import FaultName
from surveilnav.simulator.world.continuous_robot import MotionLimits
from surveilnav.simulator.world.localisation import LocalisationSettings


class CameraHardwareSettings(BaseSettings):
    """All cameras of a simulated building. Their building is that of ``SURVEILNAV_SIM__...``."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_CAMERA_HARDWARE__", extra="ignore")

    host: str = Field("127.0.0.1", description="address at which they listen")
    port: int = Field(8554, ge=1, le=65535, description="... and port; each camera has a path, its name")
    fps: float = Field(2.0, gt=0, le=30, description="pictures a second of each")


class RobotHardwareSettings(BaseSettings):
    """One simulated robot with ROS 2 and Nav2. Its building is that of ``SURVEILNAV_SIM__...``."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_ROBOT_HARDWARE__", extra="ignore")

    router: str = Field("tcp/127.0.0.1:7447", description="endpoint of the Zenoh router that its nodes use")
    domain: int = Field(0, ge=0, le=232, description="its ROS domain id")
    namespace: str = Field("", description="namespace of its node and topics, such as /robot1; empty: none")
    stamped_commands: bool = Field(False, description="cmd_vel is TwistStamped, as in newer distributions, not Twist")
    publish_map: bool = Field(
        False, description="publish its floor as an OccupancyGrid on map, as Nav2's map server does"
    )
    sim_time: bool = Field(False, description="stamps count from its start, as with use_sim_time; published on clock")
    clock_offset_s: float = Field(0.0, description="its clock is ahead of this machine's by this much")

    start: str = Field(
        "", description="where it starts: x,y,floor,yaw_deg in the building; empty: a place chosen by the seed"
    )
    start_for: str = Field("", description="start out of sight of this target, and at least 5 m away from it")
    map_x_m: float = Field(0.0, description="where its map's origin lies in the building: x")
    map_y_m: float = Field(0.0, description="... y")
    map_yaw_deg: float = Field(0.0, description="... and how the map is turned")
    drift: float = Field(
        0.01, ge=0, le=0.5, description="by which share of the way its odometry is too long or too short"
    )
    yaw_drift_deg_per_m: float = Field(0.3, ge=0, description="by how much its odometry's heading turns away per metre")
    localisation_sigma_m: float = Field(0.02, ge=0, description="standard deviation of its position after a correction")
    localisation_sigma_deg: float = Field(0.5, ge=0, description="standard deviation of its heading after a correction")
    localisation_period_s: float = Field(1.0, gt=0, description="time between two corrections")

    max_speed_m_s: float = Field(0.5, gt=0, description="highest speed")
    max_turn_rate_rad_s: float = Field(1.2, gt=0, description="highest turn rate")

    pictures_hz: float = Field(4.0, gt=0, le=20, description="pictures a second, while somebody subscribes to them")
    camera_width_px: int = Field(640, ge=16, le=4096, description="width of its pictures")
    camera_height_px: int = Field(480, ge=16, le=4096, description="height of its pictures")
    camera_hfov_deg: float = Field(79.0, gt=1, lt=170, description="horizontal field of view of its camera")
    camera_height_m: float = Field(CAMERA_HEIGHT_M, gt=0, description="height of its camera above the floor")
    camera_tilt_deg: float = Field(0.0, ge=-90, le=90, description="tilt of its camera, positive upwards")
    depth_min_m: float = Field(DEPTH_RANGE_M[0], ge=0, description="nearest depth that its camera measures")
    depth_max_m: float = Field(DEPTH_RANGE_M[1], gt=0, description="farthest depth that its camera measures")
    compressed: bool = Field(False, description="send CompressedImage (JPEG, and compressedDepth) and no raw pictures")
    depth_encoding: Literal["16UC1", "32FC1"] = Field("16UC1", description="depth in millimetres or in metres")

    scanner: bool = Field(False, description="its robot file names its laser scanner, so that SurveilNav uses it, too")

    health_file: Path | None = Field(None, description="a file that it touches each second; empty: none")
    faults: list[FaultName] = Field([], description='what goes wrong, such as ["no_depth"]; empty: nothing')
    fault_after_s: float = Field(5.0, ge=0, description="faults during a goal happen this long after it was accepted")
    jump_m: float = Field(0.5, description="SIGUSR1 has its localisation jump by this much, in x of its map")
    restart_new_map: bool = Field(True, description="SIGUSR2, which restarts its odometry, also starts a new map there")

    def camera(self) -> Pinhole:
        return Pinhole.from_hfov(self.camera_width_px, self.camera_height_px, math.radians(self.camera_hfov_deg))

    def limits(self) -> MotionLimits:
        return MotionLimits(speed_m_s=self.max_speed_m_s, turn_rate_rad_s=self.max_turn_rate_rad_s)

    def localisation(self) -> LocalisationSettings:
        return LocalisationSettings(
            PlanarTransform(self.map_x_m, self.map_y_m, math.radians(self.map_yaw_deg)),
            self.drift,
            math.radians(self.yaw_drift_deg_per_m),
            self.localisation_sigma_m,
            math.radians(self.localisation_sigma_deg),
            self.localisation_period_s,
        )
