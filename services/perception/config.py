"""Settings of the perception service: environment variables ``SURVEILNAV_PERCEPTION__<FIELD>``."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import DEFAULT_DETECTORS, DEFAULT_LARGE_DETECTORS


class PerceptionSettings(BaseSettings):
    """Which backend runs, and how much waits in front of it."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_PERCEPTION__", extra="ignore", env_ignore_empty=True)

    worker: str = Field(default="perception-1", pattern=ID_PATTERN, description="this worker's name in its keys")
    backend: str = Field(default="auto", description=f"one of {', '.join(BackendName)}")
    detectors: list[str] = Field(default=list(DEFAULT_DETECTORS), description="onnx-coco's networks (JSON list)")
    large_detectors: list[str] = Field(default=list(DEFAULT_LARGE_DETECTORS), description="the same for cameras' views")
    detector: str = Field(default="", description="paper, yolo-world: another detector: a model, or a folder")
    segmenter: str = Field(default="", description="paper, yolo-world: another segmenter, or depth-in-box")
    embedder: str = Field(default="", description="paper, yolo-world: another embedder")
    words_per_pass: int = Field(
        default=0, ge=0, description="paper, with Grounding DINO: words looked for at once; 0: as many as fit"
    )
    threshold: float | None = Field(
        default=None, ge=0, le=1, description="paper, yolo-world: the score a box needs; not set: its model's"
    )
    device: str = Field(
        default="auto", description="networks under PyTorch: auto (a GPU if there is one), cpu, cuda, cuda:1"
    )
    compiled: bool = Field(
        default=False, description="compile networks under PyTorch on a GPU; the first pictures then take minutes"
    )
    threads: int = Field(default=1, ge=1, le=64, description="threads of each network")
    simulated: bool = Field(
        default=False, description="whether the building is: auto may then take what learnt from rendered homes"
    )
    seed: int = Field(default=0, description="of the backend simulated")
    download: bool = Field(default=True, description="whether missing weights of up to 100 MB may be downloaded")
    capacity: int = Field(default=16, ge=1, description="views that may be under way; more are refused")
    max_batch: int | None = Field(
        default=None,
        ge=1,
        le=256,
        description="views that a stage takes at once, if they wait; not set: as suits the backend",
    )
    decoders: int = Field(default=2, ge=1, le=64, description="threads that decode pictures")
    cache_mb: int = Field(default=32, ge=0, description="memory for answers given before; 0: none are kept")
    kept_mb: int = Field(
        default=1000,
        ge=0,
        description="disk for answers to camera views of a simulated building, which show the same in every run; 0: none",
    )
    truth_wait_s: float = Field(default=2.0, ge=0, description="oracle, simulated: how long to wait for instance ids")
    truth_kept: int = Field(default=256, ge=1, description="oracle and simulated: views whose instance ids are kept")
