"""What backends are called. It imports none of them: who only names one loads no network."""

from __future__ import annotations

from enum import StrEnum


class BackendName(StrEnum):
    """Every name that settings and options take; ``AUTO`` stands for the best that runs."""

    AUTO = "auto"
    COMPACT = "compact"
    ONNX_COCO = "onnx-coco"
    PAPER = "paper"
    YOLO_WORLD = "yolo-world"
    ORACLE = "oracle"
    SIMULATED = "simulated"

    @property
    def too_large_for_camera(self) -> bool:
        """Whether its networks run in the perception service alone."""
        return self in (BackendName.PAPER, BackendName.YOLO_WORLD)
