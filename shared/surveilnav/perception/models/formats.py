"""Whether a file is whole and holds what its suffix says, as far as its format tells."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from typing import Any, Final

import msgspec

from surveilnav.errors import PerceptionError
from surveilnav.perception.runtime import Runtime

_LARGEST_HEADER = 100_000_000  # bytes: of a safetensors file, by its specification
#: How PyTorch's files began before version 1.6: a pickled number. Such a file doesn't say how long it should be.
_OLD_TORCH: Final = bytes.fromhex("80028a0a6cfc9c46f9206aa850192e")


def whole(path: Path) -> None:
    """PerceptionError: a file is empty, cut off or no JSON, as far as its format tells."""
    try:
        size = path.stat().st_size
        if size == 0:
            raise PerceptionError(f"{path} is empty: remove it, and pull or copy it again")
        if path.suffix == ".json":
            msgspec.json.decode(path.read_bytes())
        elif path.suffix == ".safetensors" and size != (should := _size_by_header(path)):
            raise PerceptionError(
                f"{path} isn't whole: {size:,} bytes are there, its beginning speaks of {should:,}. "
                "Remove it, and pull or copy it again."
            )
    except msgspec.DecodeError as error:
        raise PerceptionError(f"{path} is damaged ({error}): remove it, and pull or copy it again") from error
    except OSError as error:
        raise PerceptionError(f"{path} can't be read: {error.strerror}") from error


def _size_by_header(path: Path) -> int:
    """How large a safetensors file should be, in bytes, by its header: a length, a table of tensors, their bytes."""
    with path.open("rb") as file:
        length = struct.unpack("<Q", file.read(8).ljust(8, b"\xff"))[0]
        if length > _LARGEST_HEADER:
            raise PerceptionError(f"{path} is no safetensors file: remove it, and pull or copy it again")
        table = msgspec.json.decode(file.read(length), type=dict[str, dict[str, Any]])
    ends = [int(tensor["data_offsets"][1]) for tensor in table.values() if "data_offsets" in tensor]
    return 8 + int(length) + max(ends, default=0)


def readable(path: Path) -> None:
    """PerceptionError: an ONNX network can't be opened, or PyTorch's weights aren't those or are cut off.

    It costs what opening costs, so it is for files whose hash nobody knows.
    """
    if path.suffix == ".onnx":
        from surveilnav.perception.detectors.onnx_file import (
            open_session,
        )  # who only lists models needs no ONNX Runtime

        open_session(path, Runtime("cpu"))
    elif path.suffix in (".pt", ".bin"):
        _expect_torch(path)


def _expect_torch(path: Path) -> None:
    """PerceptionError: a file isn't as PyTorch saves it: a zip archive, whose table stands at its end."""
    try:
        with path.open("rb") as file:
            begins_as = file.read(len(_OLD_TORCH))
        is_torch = begins_as == _OLD_TORCH or (begins_as.startswith(b"PK") and zipfile.is_zipfile(path))
    except OSError as error:
        raise PerceptionError(f"{path} can't be read: {error.strerror}") from error
    if not is_torch:
        raise PerceptionError(f"{path} isn't what PyTorch saves, or isn't whole: remove it, and pull or copy it again")
