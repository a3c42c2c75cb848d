"""Settings of the fusion service: environment variables ``SURVEILNAV_FUSION__<FIELD>``, parts by ``__``.

``SURVEILNAV_FUSION__VALUE__FUSION=average`` changes one number of ``surveilnav.services.fusion.core.config``.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.errors import ConfigError
from surveilnav.services.fusion.core import FusionConfig


class FusionSettings(BaseSettings):
    """How the joint maps are made, and what they are made of."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_FUSION__", env_nested_delimiter="__", extra="ignore")

    surveillance: bool = Field(default=True, description="false: no camera is ever invoked")
    preset: Literal["default", "paper"] = Field(default="default", description="where the parts below start from")
    map: dict[str, Any] = Field(default={}, description="what differs from the preset, see core.config.MapConfig")
    value: dict[str, Any] = Field(default={}, description="... ValueConfig")
    objects: dict[str, Any] = Field(default={}, description="... ObjectConfig, by part")
    validation: dict[str, Any] = Field(default={}, description="... ValidationConfig")
    views: dict[str, Any] = Field(default={}, description="... ViewOrderConfig")
    store: str = Field(
        default="", description="file that the maps survive in (SQLite); empty: they end with the process"
    )
    snapshot_views: int = Field(default=100, ge=1, description="views logged between two snapshots of the maps")
    snapshot_mb: int = Field(default=256, ge=1, description="... or megabytes of them")
    max_events: int = Field(default=1_000_000, ge=1, description="of objects, kept in the store; the oldest go first")
    prompts: list[str] = Field(
        default=[],
        description="words that detectors with an open vocabulary always look for, beside the missions' (JSON list)",
    )
    picture_cache_mb: int = Field(
        default=256, ge=0, description="of cameras' newest pictures, looked at again when a mission brings a new word"
    )
    camera_views_per_step: int = Field(
        default=2, ge=1, description="camera views integrated between two looks at robots"
    )
    prefetch_cameras: int = Field(
        default=0,
        ge=0,
        le=64,
        description="while nobody searches, so many cameras at once that no robot is near are looked "
        "through once; 0: none are, and they send nothing",
    )
    linger_s: float = Field(default=10.0, ge=0, description="how long a camera stays invoked after the last robot left")
    resend_after_s: float = Field(default=5.0, gt=0, description="a view that hasn't come by then is asked for again")
    robot_timeout_s: float = Field(default=10.0, gt=0, description="a robot silent for so long activates no camera")
    infer_timeout_s: float = Field(default=30.0, gt=0, description="a worker that takes longer is asked again")
    retry_s: float = Field(default=0.5, gt=0, description="pause before perception is asked again")

    def core(self) -> FusionConfig:
        """The preset with what was set on top. ConfigError: a name or a number that can't be."""
        changes = {part: getattr(self, part) for part in ("map", "value", "objects", "validation", "views")}
        try:
            return FusionConfig.preset(self.preset).changed(changes)
        except ValidationError as error:
            fault = error.errors()[0]
            name = "__".join(str(p).upper() for p in fault["loc"])
            raise ConfigError(f"SURVEILNAV_FUSION__{name}: {fault['msg']}, got {fault['input']!r}") from error
