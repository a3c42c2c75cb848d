"""Settings of the recorder, from environment variables ``SURVEILNAV_RECORDER__<FIELD>``."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN


class RecorderSettings(BaseSettings):
    """Where recordings are written, how long they are kept, and how often maps are recorded."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_RECORDER__", extra="ignore")

    folder: Path = Field(
        default=Path("runs/recordings"),
        description="the folder where recordings are written, one file for each mission",
    )
    id: str = Field(default="recorder", pattern=ID_PATTERN, description="the recorder's name on the bus")
    max_mb: int = Field(
        default=8192,
        ge=0,
        description="limit for all recordings in the folder together, those of earlier runs included [MB]: the oldest are "
        "deleted first, never one that is being written; 0: no limit",
    )
    max_days: float = Field(default=30.0, ge=0, description="recordings older than this are deleted; 0: no limit")
    min_free_mb: int = Field(
        default=512,
        ge=0,
        description="recording stops when less space is left on the disk, which other programs need [MB]",
    )
    flush_s: float = Field(default=1.0, gt=0, le=60, description="a crash loses at most what was recorded in this time")
    queue_mb: int = Field(
        default=32,
        ge=1,
        description="size of the queue for a slow disk [MB]; messages that don't fit are dropped and counted",
    )
    layers_s: float = Field(default=3.0, gt=0, description="interval at which a floor's grids and objects are recorded")
    cloud_s: float = Field(default=30.0, gt=0, description="interval at which a floor's point cloud is recorded")
