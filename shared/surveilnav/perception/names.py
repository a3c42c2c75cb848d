"""Names of the backends. This module imports none of them, so that naming one loads no network."""

from __future__ import annotations

from enum import StrEnum


class BackendName(StrEnum):
    """Names that settings and options accept; ``AUTO`` stands for the best backend that runs."""

    AUTO = "auto"
    COMPACT = "compact"
    ONNX_COCO = "onnx-coco"
    PAPER = "paper"
    YOLO_WORLD = "yolo-world"
    ORACLE = "oracle"
    SIMULATED = "simulated"

    @property
    def too_large_for_camera(self) -> bool:
        """Whether its networks run only in the perception service, never in a camera node."""
        return self in (BackendName.PAPER, BackendName.YOLO_WORLD)

    @property
    def is_told(self) -> bool:
        """Whether it is told a simulator's truth, and looks at no picture."""
        return self in (BackendName.ORACLE, BackendName.SIMULATED)
