"""Zip files from strangers, and pictures in them: read with limits, never unpacked to disk."""

from __future__ import annotations

import io
import lzma
import struct
import warnings
import zipfile
import zlib
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from surveilnav.errors import BuildingError

MAX_MEMBERS = 50_000
MAX_TOTAL_BYTES = 2 << 30
MAX_MEMBER_BYTES = 256 << 20
#: Text of coordinates compresses about tenfold, a bomb a thousandfold; small members may do what they like.
MAX_RATIO = 200
RATIO_FREE_BYTES = 1 << 20
MAX_PICTURE_PIXELS = 40_000_000
MAX_TEXTURE_PX = 512


class Archive:
    """A zip file from a stranger, checked when it is opened: it keeps to the limits, and no member's path leads out of it.

    Raises:
        BuildingError: not a zip, damaged, a bomb, or with names that climb out of it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._zip = zipfile.ZipFile(path)
        except FileNotFoundError as error:
            raise BuildingError(f"there is no file {path}") from error
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, struct.error) as error:
            raise BuildingError(
                f"{path} can't be opened as a zip file ({error}): it is damaged, cut short, or no Sweet Home 3D file"
            ) from error
        try:
            self._check()
        except BuildingError:
            self._zip.close()
            raise
        self._names = {info.filename.lower(): info for info in self._zip.infolist()}

    def _check(self) -> None:
        infos = self._zip.infolist()
        if len(infos) > MAX_MEMBERS:
            raise BuildingError(f"{self.path} has {len(infos)} members, more than {MAX_MEMBERS}: refused")
        if sum(info.file_size for info in infos) > MAX_TOTAL_BYTES:
            raise BuildingError(
                f"{self.path} would unpack to more than {MAX_TOTAL_BYTES >> 20} MiB: refused as a zip bomb"
            )
        for info in infos:
            name = info.filename
            if name.startswith(("/", "\\")) or ".." in PurePosixPath(name.replace("\\", "/")).parts or ":" in name[:3]:
                raise BuildingError(f"{self.path} has a member that points outside of it, {name[:80]!r}: refused")
            if info.file_size > MAX_MEMBER_BYTES:
                raise BuildingError(f"{self.path}: {name[:80]!r} is larger than {MAX_MEMBER_BYTES >> 20} MiB: refused")
            if info.file_size > RATIO_FREE_BYTES and info.file_size > MAX_RATIO * max(1, info.compress_size):
                raise BuildingError(
                    f"{self.path}: {name[:80]!r} unpacks {MAX_RATIO} times its size: refused as a zip bomb"
                )

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._zip.close()

    def fingerprint(self, name: str) -> str:
        """Something that changes with the member's content; "" where there is no such member."""
        info = self._names.get(name.lower().lstrip("/"))
        return f"{info.CRC:08x}-{info.file_size}" if info else ""

    def read(self, name: str) -> bytes | None:
        """A member's bytes, whatever case its name is spelt in; None where there is none.

        Raises:
            BuildingError: it is damaged, encrypted or larger than it says.
        """
        info = self._names.get(name.lower().lstrip("/"))
        if info is None or info.is_dir():
            return None
        try:
            with self._zip.open(info) as member:
                data = member.read(min(info.file_size, MAX_MEMBER_BYTES) + 1)
        except (
            zipfile.BadZipFile,
            OSError,
            RuntimeError,
            NotImplementedError,
            EOFError,
            zlib.error,
            lzma.LZMAError,
        ) as error:
            raise BuildingError(
                f"{self.path}: {info.filename!r} can't be read ({error}): the file is damaged"
            ) from error
        if len(data) > info.file_size:
            raise BuildingError(f"{self.path}: {info.filename!r} is larger than it says: refused as a zip bomb")
        return data


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of a PNG, JPEG or BMP by its header alone; None for anything else, and for what Pillow takes for a
    decompression bomb."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "BMP")) as picture:
                return picture.size
    except (
        OSError,
        ValueError,
        SyntaxError,
        struct.error,
        Image.DecompressionBombError,
        Image.DecompressionBombWarning,
    ):
        return None


def decode_picture(
    data: bytes, max_px: int = MAX_TEXTURE_PX
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None] | None:
    """RGB (H, W, 3) and opacity (H, W) or None, at most ``max_px`` wide and high; None if it can't be decoded."""
    size = picture_size(data)
    if size is None or not (0 < size[0] * size[1] <= MAX_PICTURE_PIXELS):
        return None
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if picture is None or picture.size == 0:
            return None
        if picture.dtype == np.uint16:
            picture = (picture >> 8).astype(np.uint8)
        scale = max_px / max(picture.shape[:2])
        if scale < 1:
            target = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
            picture = cv2.resize(picture, target, interpolation=cv2.INTER_AREA)
    except cv2.error:
        return None
    if picture.dtype != np.uint8:
        return None
    if picture.ndim == 2:
        return np.repeat(picture[..., None], 3, axis=2), None
    alpha = np.ascontiguousarray(picture[..., 3]) if picture.shape[2] == 4 else None
    if alpha is not None and alpha.min() >= 250:
        alpha = None
    return np.ascontiguousarray(picture[..., 2::-1]), alpha
