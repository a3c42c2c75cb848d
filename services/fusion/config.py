"""Settings of the fusion service: environment variables ``SURVEILNAV_FUSION__<FIELD>``, parts by ``__``.

``SURVEILNAV_FUSION__VALUE__FUSION=average`` changes one number of ``surveilnav.services.fusion.core.config``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID
from surveilnav.errors import ConfigError
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.priors import load_priors
from surveilnav.services.fusion.shard import Shard


class FusionSettings(BaseSettings):
    """Settings of the fusion service and of the joint maps."""

    model_config = SettingsConfigDict(
        env_prefix="SURVEILNAV_FUSION__", env_nested_delimiter="__", extra="ignore", env_ignore_empty=True
    )

    building_file: str = Field(
        default="",
        description="`building.yaml`: where it names Nav2's map of a floor, that is known before anybody has seen the floor. "
        "Empty: nothing is",
    )
    surveillance: bool = Field(default=True, description="whether surveillance cameras are invoked at all")
    preset: Literal["default", "paper"] = Field(
        default="default", description="settings of the maps that the parts below start from"
    )
    map: dict[str, Any] = Field(default={}, description="settings that differ from the preset: core.config.MapConfig")
    value: dict[str, Any] = Field(default={}, description="... ValueConfig")
    objects: dict[str, Any] = Field(default={}, description="... ObjectConfig, by part")
    validation: dict[str, Any] = Field(default={}, description="... ValidationConfig")
    views: dict[str, Any] = Field(default={}, description="... ViewOrderConfig")
    store: str = Field(
        default="",
        description="SQLite file that keeps the maps over a restart; empty: they are lost when the process ends. With shards, "
        "each has a file of its own beside it, whose name ends with the shard's",
    )
    shards: dict[str, list[str]] = Field(
        default={},
        description='the floors of each shard by its name, as in {"low": ["0", "1"], "high": ["2"]}: so many fusion services are '
        "started alike, and each takes a shard that no other has; empty: one service maps the whole building",
    )
    snapshot_views: int = Field(
        default=100, ge=1, description="a snapshot of the maps is written after this many logged views"
    )
    snapshot_mb: int = Field(default=256, ge=1, description="... or this many megabytes of them")
    log_views: int = Field(
        default=1000,
        ge=0,
        description="so many of the newest views the log keeps, so that what a camera or a robot contributed to the maps can be "
        "taken out again exactly; 0, or if pictures are deleted by age: only those that a restart needs",
    )
    log_mb: int = Field(default=512, ge=0, description="... and at most so many megabytes of them")
    max_events: int = Field(
        default=1_000_000,
        ge=1,
        description="events of objects that are kept in the store; the oldest are dropped first",
    )
    prompts: list[str] = Field(
        default=[],
        description="words that open-vocabulary detectors always look for, in addition to the missions' targets (JSON list)",
    )
    picture_cache_mb: int = Field(
        default=256,
        ge=0,
        description="size of the cache of cameras' newest pictures, which are perceived again when a mission brings a new word",
    )
    camera_views_per_step: int = Field(
        default=2, ge=1, description="camera views that are integrated before robots' views get their turn again"
    )
    prefetch_cameras: int = Field(
        default=0,
        ge=0,
        le=64,
        description="while no mission is open, this many cameras at a time that no robot is near are invoked until each of "
        "their views is in the maps; 0: none",
    )
    linger_s: float = Field(
        default=10.0, ge=0, description="how long a camera stays invoked after the last robot has left its floor"
    )
    resend_after_s: float = Field(
        default=5.0, gt=0, description="a camera view that hasn't arrived by then is requested again"
    )
    robot_timeout_s: float = Field(
        default=10.0, gt=0, description="a robot that has been silent for so long invokes no cameras"
    )
    infer_timeout_s: float = Field(
        default=30.0, gt=0, description="time-out of a request to perception, after which it is sent again"
    )
    retry_s: float = Field(
        default=0.5,
        gt=0,
        description="pause before a failed request to perception, or a failed write to the store, is tried again",
    )

    @field_validator("shards")
    @classmethod
    def _check_shards(cls, shards: dict[str, list[str]]) -> dict[str, list[str]]:
        floors = [floor for listed in shards.values() for floor in listed]
        if bad := [name for name in (*shards, *floors) if re.fullmatch(ID, name) is None]:
            raise ValueError(f"names of shards and floors have letters, digits, '_', '.', '-'; got {bad[0]!r:.80}")
        if empty := [name for name, listed in shards.items() if not listed]:
            raise ValueError(f"shard {empty[0]!r} has no floors")
        if twice := sorted({floor for floor in floors if floors.count(floor) > 1}):
            raise ValueError(f"floor {twice[0]!r} is listed twice; each floor belongs to one shard")
        return shards

    def shard(self, name: str) -> Shard:
        """The shard of that name."""
        return Shard(name, frozenset(self.shards[name]))

    def for_shard(self, name: str) -> FusionSettings:
        """The settings of the service that has this shard: its store is its own."""
        path = Path(self.store)
        store = str(path.with_name(f"{path.stem}-{name}{path.suffix}")) if self.store else ""
        return self.model_copy(update={"store": store})

    def core(self) -> FusionConfig:
        """The preset with the settings that differ from it.

        ConfigError: an unknown name, an invalid value, or a building file that can't be used.
        """
        changes = {part: getattr(self, part) for part in ("map", "value", "objects", "validation", "views")}
        try:
            config = FusionConfig.preset(self.preset).changed(changes)
        except ValidationError as error:
            fault = error.errors()[0]
            name = "__".join(str(p).upper() for p in fault["loc"])
            raise ConfigError(f"SURVEILNAV_FUSION__{name}: {fault['msg']}, got {fault['input']!r}") from error
        priors = load_priors(self.building_file, config.map.max_extent_m)
        return config.model_copy(update={"map": config.map.with_priors(priors)}) if priors else config
