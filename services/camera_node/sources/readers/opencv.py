"""What the readers that decode with OpenCV's FFmpeg or V4L2 have in common.

OpenCV's wheels hold an FFmpeg under the LGPL, with decoders for H.264 and H.265 and without the GPL's encoders.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

import cv2
import numpy as np

from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame, StreamError

OPEN_TIMEOUT_MS, READ_TIMEOUT_MS = 6_000, 5_000


def silence_decoders() -> None:
    """Keeps OpenCV and FFmpeg from writing to the log: their messages hold addresses, and with them passwords."""
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class OpenCVReader:
    """Reads a stream with ``cv2.VideoCapture``.

    Args:
        target: address, path or number of a device.
        backend: OpenCV's number of the backend, such as ``cv2.CAP_FFMPEG``.
        parameters: pairs of property and value with which it is opened.
        period_s: least time between two pictures that are wanted. Those between are taken from the stream but not converted.
    """

    bytes_read = 0

    def __init__(self, target: str | int, backend: int, parameters: Sequence[int], period_s: float) -> None:
        self._target, self._backend, self._parameters, self._period_s = target, backend, list(parameters), period_s
        self._capture: cv2.VideoCapture | None = None
        self._last_s = -1e9

    def open(self) -> None:
        """Opens the stream. Raises StreamError if that fails."""
        silence_decoders()
        self._capture = cv2.VideoCapture(self._target, self._backend, self._parameters)
        if not self._capture.isOpened():
            self.close()
            raise StreamError(self.diagnose())

    def diagnose(self) -> str:
        """Why the stream can't be opened, for people."""
        return "it can't be opened"

    def read(self) -> CapturedFrame:
        """Waits until the next picture is wanted and there. Raises StreamError when the stream has ended or stalled."""
        while True:
            capture = self._capture
            if capture is None or not capture.grab():
                raise StreamError("the stream has ended or stalled")
            now_s = time.monotonic()
            if now_s - self._last_s >= self._period_s:
                break
        ok, bgr = capture.retrieve()
        if not ok or bgr is None or bgr.size == 0:
            raise StreamError("a picture can't be decoded")
        self._last_s = now_s
        rgb = cv2.cvtColor(bgr, cv2.COLOR_GRAY2RGB if bgr.ndim == 2 else cv2.COLOR_BGR2RGB)
        return CapturedFrame(np.asarray(rgb, np.uint8), time.time_ns(), "arrival")

    def close(self) -> None:
        """Closes the stream."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()
