"""Settings of a robot node: environment variables ``SURVEILNAV_ROBOT__<FIELD>``."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN


class RobotSettings(BaseSettings):
    """One simulated robot."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_ROBOT__", extra="ignore")

    id: str = Field("r1", pattern=ID_PATTERN, description="its name in its keys")
    start: str = Field("", description="x,y,floor,yaw_deg in the world; empty: a place drawn by the seed")
    start_for: str = Field("", description="begin out of sight and at least 5 m away from this target")
    store: str = Field(
        "", description="a file that keeps where it stands, and beside it whether it is halted; empty: nothing"
    )
    jpeg_quality: int = Field(90, ge=10, le=100, description="of its observations")
