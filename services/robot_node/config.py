"""Settings of a robot node: environment variables ``SURVEILNAV_ROBOT__<FIELD>``."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN


class RobotSettings(BaseSettings):
    """One robot: of a robot file or, without one, a simulated robot."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_ROBOT__", extra="ignore")

    id: str = Field("r1", pattern=ID_PATTERN, description="the robot's name on the bus")
    file: str = Field(
        "", description="the robot file of a real robot, such as robot.yaml; empty: a robot of the simulated building"
    )
    observation_hz: float = Field(
        2.0, gt=0, le=10, description="how often a robot observes at most while it drives to a waypoint by itself"
    )
    start: str = Field(
        "", description="where the robot starts: x,y,floor,yaw_deg in the world; empty: a place chosen by the seed"
    )
    start_for: str = Field("", description="start out of sight of this target, and at least 5 m away from it")
    store: str = Field(
        "",
        description="a file that keeps the robot's place and whether it is halted over a restart; empty: neither is kept",
    )
    jpeg_quality: int = Field(90, ge=10, le=100, description="JPEG quality of the observations")
