"""Settings of a camera node: environment variables ``SURVEILNAV_CAMERA__<FIELD>``."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class CameraSettings(BaseSettings):
    """One simulated surveillance camera."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_CAMERA__", extra="ignore")

    id: str = Field("", description="a camera of the plan; empty: lease any free slot of it")
    jpeg_quality: int = Field(85, ge=10, le=100)
    thumbnail_width_px: int = Field(480, ge=64, le=1280)
