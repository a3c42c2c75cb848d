"""Pictures from a folder into which another program writes them: the newest one counts."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np

from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame, StreamError

_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".webp"}
_POLL_S, _WAIT_S = 0.2, 1.0
#: A file that can't be decoded may still be being written: it is tried again for this long.
_WRITING_S = 2.0


class FolderReader:
    """Waits for files in a folder. The time of capture is that of the file's last change."""

    bytes_read = 0

    def __init__(self, path: Path, period_s: float) -> None:
        self._path, self._period_s = path, period_s
        self._seen: tuple[str, int] = ("", 0)

    def open(self) -> None:
        """Raises StreamError if there is no such folder."""
        if not self._path.is_dir():
            raise StreamError(f"{self._path} isn't a folder")

    def read(self) -> CapturedFrame | None:
        """Waits for a picture that is newer than the last one."""
        until_s = time.monotonic() + _WAIT_S
        while time.monotonic() < until_s:
            name, changed_ns = self._newest()
            if name and (name, changed_ns) != self._seen:
                bgr = self._decode(self._path / name, changed_ns)
                if bgr is not None:
                    self._seen = name, changed_ns
                    rgb = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)
                    return CapturedFrame(rgb, changed_ns, "file")
            time.sleep(min(_POLL_S, self._period_s))
        return None

    def close(self) -> None:
        """Nothing is open between two pictures."""

    def _newest(self) -> tuple[str, int]:
        try:
            files = [(p.stat().st_mtime_ns, p.name) for p in self._path.iterdir() if p.suffix.lower() in _SUFFIXES]
        except FileNotFoundError:  # a file was removed meanwhile, or the folder was
            if not self._path.is_dir():
                raise StreamError(f"the folder {self._path} is gone") from None
            return "", 0
        changed_ns, name = max(files, default=(0, ""))
        return name, changed_ns

    def _decode(self, path: Path, changed_ns: int) -> np.ndarray | None:
        try:
            data = np.frombuffer(path.read_bytes(), np.uint8)
        except OSError:
            return None
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        if bgr is None and time.time_ns() - changed_ns > _WRITING_S * 1e9:
            raise StreamError(f"{path.name} isn't a picture")
        return bgr
