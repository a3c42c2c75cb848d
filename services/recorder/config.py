"""Settings of the recorder: environment variables ``SURVEILNAV_RECORDER__<FIELD>``."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN


class RecorderSettings(BaseSettings):
    """Where recordings go, how many are kept, and how often what changes slowly is drawn."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_RECORDER__", extra="ignore")

    folder: Path = Field(default=Path("runs/recordings"), description="where recordings go, a file a mission")
    id: str = Field(default="recorder", pattern=ID_PATTERN, description="its name on the bus")
    max_mb: int = Field(
        default=8192,
        ge=0,
        description="megabytes of all recordings in the folder, those of earlier runs too: the oldest go "
        "first, never one that is being written; 0: no limit",
    )
    max_days: float = Field(default=30.0, ge=0, description="recordings older than this are deleted; 0: none is")
    min_free_mb: int = Field(
        default=512, ge=0, description="recording stops when less is left on the disk: others write there, too"
    )
    flush_s: float = Field(default=1.0, gt=0, le=60, description="a crash loses at most what was recorded in so long")
    queue_mb: int = Field(
        default=32, ge=1, description="what may wait for a slow disk; messages beyond it are dropped and counted"
    )
    layers_s: float = Field(default=3.0, gt=0, description="between two drawings of a floor's grids and objects")
    cloud_s: float = Field(default=30.0, gt=0, description="between two drawings of a floor's cloud")
