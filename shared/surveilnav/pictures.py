"""The setting for how long past pictures may be kept, which all processes share."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class PictureSettings(BaseSettings):
    """Retention of past pictures."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_PICTURES__", extra="ignore", env_ignore_empty=True)

    keep_h: float | None = Field(
        None,
        ge=0.01,
        le=100_000,
        description="hours after which past pictures are deleted: from fusion's store, with their recordings, and with the "
        "reports of older runs when the next demo begins; not set: store and recordings only have their own limits, reports stay",
    )

    @property
    def keep_s(self) -> float | None:
        return None if self.keep_h is None else self.keep_h * 3600.0
