"""Pictures from a video file, at its own pace and over and over: for tests and demonstrations."""

from __future__ import annotations

import math
import time
from pathlib import Path

import cv2

from surveilnav.services.camera_node.sources.readers.opencv import OpenCVReader
from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame, StreamError


class VideoFileReader(OpenCVReader):
    """Plays a video file in a loop."""

    def __init__(self, path: Path, period_s: float) -> None:
        super().__init__(str(path), cv2.CAP_FFMPEG, [], period_s=0.0)
        self._path, self._wanted_period_s = path, period_s
        self._begun_s = self._shown_s = 0.0

    def diagnose(self) -> str:
        """Whether the file is missing or no video."""
        return f"{self._path} isn't a video that can be decoded" if self._path.exists() else f"there is no {self._path}"

    def open(self) -> None:
        """Opens the file and begins to play."""
        super().open()
        self._begun_s, self._shown_s = time.monotonic(), -math.inf

    def read(self) -> CapturedFrame:
        """The next wanted picture, when it is due. A machine that is too slow plays the file more slowly."""
        n_rewound = 0
        while True:
            try:
                frame = super().read()
            except StreamError:
                if n_rewound:
                    raise
                n_rewound += 1
                self.close()
                self.open()
                continue
            position_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3 if self._capture else 0.0
            if position_s - self._shown_s >= self._wanted_period_s - 1e-3:
                break
        late_s = time.monotonic() - (self._begun_s + position_s)
        self._begun_s += max(0.0, late_s)
        time.sleep(max(0.0, -late_s))
        self._shown_s = position_s
        return CapturedFrame(frame.rgb, time.time_ns(), "file")
