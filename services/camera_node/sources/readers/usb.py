"""Pictures from a camera at a USB port (Linux: V4L2)."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2

from surveilnav.services.camera_node.sources.readers.opencv import OpenCVReader


class UsbReader(OpenCVReader):
    """Reads a USB camera, ``usb:0`` or ``/dev/video0``, at a resolution that it supports.

    Args:
        device: as above.
        size_px: (width, height) of the pictures that the lens was calibrated for.
    """

    def __init__(self, device: str, size_px: tuple[int, int], period_s: float) -> None:
        number = int(device.removeprefix("usb:").removeprefix("/dev/video"))
        backend = cv2.CAP_V4L2 if sys.platform == "linux" else cv2.CAP_ANY
        size = [cv2.CAP_PROP_FRAME_WIDTH, size_px[0], cv2.CAP_PROP_FRAME_HEIGHT, size_px[1]]
        super().__init__(number, backend, size, period_s)
        self._number = number

    def diagnose(self) -> str:
        """Whether the device is missing, forbidden or busy."""
        path = Path(f"/dev/video{self._number}")
        if not path.exists():
            there = ", ".join(sorted(str(p) for p in Path("/dev").glob("video*"))) or "none"
            return f"there is no {path}; there are: {there}"
        try:
            path.open("rb").close()
        except PermissionError:
            return f"{path} may not be read: add this user to the group video"
        except OSError as error:
            return f"{path} can't be opened: {error.strerror}"
        return f"{path} is busy, or has no pictures of this size"
