"""Which reader an address needs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from surveilnav.cameras_file.passwords import passwords_in
from surveilnav.cameras_file.urls import with_secrets
from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.sources.readers.folder import FolderReader
from surveilnav.services.camera_node.sources.readers.http import HttpReader
from surveilnav.services.camera_node.sources.readers.reader import FrameReader
from surveilnav.services.camera_node.sources.readers.rtsp import RtspReader
from surveilnav.services.camera_node.sources.readers.usb import UsbReader
from surveilnav.services.camera_node.sources.readers.video_file import VideoFileReader

_USB = re.compile(r"usb:\d+|/dev/video\d+")


def choose_reader(
    stream: str, folder: Path, environment: Mapping[str, str], size_px: tuple[int, int], period_s: float
) -> FrameReader:
    """The reader of a camera's stream.

    Args:
        stream: as in cameras.yaml.
        folder: where relative paths begin, and where ``passwords.env`` may stand.
        environment: where variables in the address are looked up; before ``passwords.env``.
        size_px: (width, height) of the pictures that the lens was calibrated for.
        period_s: least time between two pictures.

    Raises:
        ConfigError: nothing can read such an address, or a variable isn't set.
    """
    try:
        address = with_secrets(stream, passwords_in(folder) | dict(environment))
    except ValueError as error:
        raise ConfigError(f"stream: {error}") from None
    scheme = address.split("://", 1)[0].lower() if "://" in address else ""
    if scheme in ("rtsp", "rtsps"):
        return RtspReader(address, period_s)
    if scheme in ("http", "https"):
        return HttpReader(address, period_s)
    if _USB.fullmatch(address):
        return UsbReader(address, size_px, period_s)
    if scheme:
        raise ConfigError(f"stream: {scheme}:// can't be read; expected rtsp, rtsps, http or https, usb:0, or a path")
    path = folder / address
    return FolderReader(path, period_s) if path.is_dir() else VideoFileReader(path, period_s)
