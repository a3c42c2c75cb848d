"""Settings of a camera node: environment variables ``SURVEILNAV_CAMERA__<FIELD>``."""

from __future__ import annotations

from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.errors import ConfigError
from surveilnav.messages import PERCEIVED_TIERS, TierChoice
from surveilnav.perception.names import BackendName


class CameraSettings(BaseSettings):
    """One surveillance camera."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_CAMERA__", extra="ignore", env_ignore_empty=True)

    file: str = Field(
        "", description="the file of real cameras (cameras.yaml); empty: a camera of the simulated building"
    )
    id: str = Field("", description="name of a camera of the file or the plan; empty: lease any free one")
    depth: Literal["network", "depth-anything", "none"] = Field(
        "none",
        description="depth of a real camera's pictures: `none`: they have none; `network`: by our own network, which uses the "
        "camera's pose and is good on rendered pictures only; `depth-anything`: by the one that DEPTH_MODEL names, fitted to the "
        "floor",
    )
    depth_model: str = Field(
        "depth-anything-v2-metric-indoor-small",
        description="depth-anything: a model of the catalogue, a folder of transformers with a metric Depth Anything, or a file "
        "`.onnx`",
    )
    max_age_s: float = Field(5.0, gt=0, description="a real camera's picture that is older doesn't count")
    tier: TierChoice = Field(
        "jpeg+depth",
        description="how much the camera sends of its views: `raw`, `jpeg+depth`, `jpeg` (no depth), `features` (what its own "
        "perception sees, with coarse depth: about a hundredth of the bytes), `objects` (objects alone), or `auto` (`features`, "
        "less or more as budget and requests have it). The last three need PERCEPTION",
    )
    budget_kb_s: float | None = Field(
        None,
        gt=0,
        description="bytes of frames that the camera may send [kB/s, of 1,000 bytes]; empty: as many as it has",
    )
    jpeg_quality: int = Field(85, ge=10, le=100, description="JPEG quality of the frames it sends")
    thumbnail_width_px: int = Field(480, ge=64, le=1280, description="width of the pictures shown to people")
    masks: str = Field(
        "",
        description="a YAML file of mask zones, which are never sent, stored or given to a detector; empty: there are none",
    )
    perception: str = Field(
        "none",
        pattern=f"^({'|'.join(('none', *BackendName))})$",
        description="backend with which the camera examines its own views, for its summary and for TIER; none, "
        f"{' and '.join(n for n in BackendName if n.too_large_for_camera)} (which are too large for a camera): it doesn't",
    )
    min_floors: int = Field(
        2,
        ge=1,
        description="the camera examines its views only in buildings with this many floors: its summary serves to choose one",
    )
    disk_cache_mb: int = Field(
        2000,
        ge=0,
        description="disk space for frames and detections of simulated views, all cameras together; 0: nothing is cached",
    )
    look_period_s: float = Field(1.0, gt=0, description="time between two views that the camera examines itself")
    threads: int = Field(1, ge=1, le=64, description="threads of the camera's own networks")
    download: bool = Field(True, description="whether missing weights may be downloaded")

    def check_tier(self) -> None:
        """ConfigError: the tier needs the camera's own perception, and the settings name none."""
        if self.tier in (*PERCEIVED_TIERS, "auto") and not self.runs_perception:
            raise ConfigError(
                f"a camera of tier {self.tier} sends what it sees itself, but its perception is {self.perception!r}: set "
                "SURVEILNAV_CAMERA__PERCEPTION=compact, or another tier"
            )

    @property
    def runs_perception(self) -> bool:
        """Whether the camera examines its own views."""
        return self.perception != "none" and not BackendName(self.perception).too_large_for_camera
