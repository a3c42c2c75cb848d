"""Settings of the perception service: environment variables ``SURVEILNAV_PERCEPTION__<FIELD>``."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import DEFAULT_DETECTORS, DEFAULT_LARGE_DETECTORS


class PerceptionSettings(BaseSettings):
    """Which backend a worker runs, and how many requests it accepts."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_PERCEPTION__", extra="ignore", env_ignore_empty=True)

    worker: str = Field(default="perception-1", pattern=ID_PATTERN, description="this worker's name in its keys")
    backend: str = Field(default="auto", description=f"one of {', '.join(BackendName)}")
    detectors: list[str] = Field(
        default=list(DEFAULT_DETECTORS), description="onnx-coco: networks for robots' views (JSON list)"
    )
    large_detectors: list[str] = Field(
        default=list(DEFAULT_LARGE_DETECTORS), description="onnx-coco: networks for cameras' views (JSON list)"
    )
    detector: str = Field(
        default="", description="paper, yolo-world: another detector, by the model's name or its folder"
    )
    segmenter: str = Field(
        default="", description="paper, yolo-world: another segmenter, in the same way, or depth-in-box"
    )
    embedder: str = Field(default="", description="paper, yolo-world: another embedder, in the same way")
    words_per_pass: int = Field(
        default=0, ge=0, description="paper, with Grounding DINO: how many words one pass looks for; 0: as many as fit"
    )
    threshold: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="paper, yolo-world: least score of a detection; not set: as the model recommends",
    )
    device: str = Field(
        default="auto", description="where networks under PyTorch run: auto (a GPU if there is one), cpu, cuda, cuda:1"
    )
    compiled: bool = Field(
        default=False, description="compile networks under PyTorch on a GPU; the first pictures then take minutes"
    )
    threads: int = Field(default=1, ge=1, le=64, description="threads of each network")
    simulated: bool = Field(
        default=False,
        description="whether the building is simulated: auto may then choose a network trained on rendered homes",
    )
    seed: int = Field(default=0, description="seed of the backend simulated")
    download: bool = Field(default=True, description="whether missing weights of up to 100 MB may be downloaded")
    capacity: int = Field(
        default=16, ge=1, description="views that may be queued or processed at a time; more are refused"
    )
    max_batch: int | None = Field(
        default=None,
        ge=1,
        le=256,
        description="views that a stage processes as one batch, if so many wait; not set: as suits the backend",
    )
    decoders: int = Field(default=2, ge=1, le=64, description="threads that decode pictures")
    cache_mb: int = Field(default=32, ge=0, description="memory for replies to earlier requests; 0: none are cached")
    disk_cache_mb: int = Field(
        default=1000,
        ge=0,
        description="disk space for replies about camera views of a simulated building, which are the same in every run; 0: none",
    )
