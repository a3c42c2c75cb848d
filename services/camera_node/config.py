"""Settings of a camera node: environment variables ``SURVEILNAV_CAMERA__<FIELD>``."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.perception.names import BackendName


class CameraSettings(BaseSettings):
    """One simulated surveillance camera."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_CAMERA__", extra="ignore")

    id: str = Field("", description="a camera of the plan; empty: lease any free slot of it")
    jpeg_quality: int = Field(85, ge=10, le=100, description="of the frames it sends")
    thumbnail_width_px: int = Field(480, ge=64, le=1280, description="of the pictures made for people")
    masks: str = Field(
        "", description="a file (YAML) of mask zones, which are never sent, kept or looked at; empty: there are none"
    )
    perception: str = Field(
        "none",
        pattern=f"^({'|'.join(('none', *BackendName))})$",
        description="with what the camera looks at its own views, for its summary; none: it doesn't, nor does it with "
        f"{' or '.join(n for n in BackendName if n.too_large_for_camera)}, which are too large for a camera",
    )
    least_floors: int = Field(
        2, ge=1, description="it looks only in buildings of so many floors: a floor is chosen among several"
    )
    kept_mb: int = Field(
        2000,
        ge=0,
        description="disk for frames and own looks of simulated views, all cameras together; 0: none are kept",
    )
    look_period_s: float = Field(1.0, gt=0, description="it looks at one of its views in so long")
    threads: int = Field(1, ge=1, le=64, description="threads of its own perception's networks")
    download: bool = Field(True, description="whether missing weights may be downloaded")

    @property
    def looks(self) -> bool:
        """Whether it looks at its own views."""
        return self.perception != "none" and not BackendName(self.perception).too_large_for_camera
