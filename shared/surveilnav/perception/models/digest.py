"""Hashes of large files, worked out once: remembered by path, size and time of change."""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

import msgspec

from surveilnav.config import cache_dir
from surveilnav.errors import SurveilNavError
from surveilnav.storage import atomic_write

#: Size in bytes, time of change in nanoseconds, sha256, by path.
Known = dict[str, tuple[int, int, str]]

_known: Known = {}


def sha256(path: Path, *, anew: bool = False) -> str:
    """The sha256 of a file's content, in hex. ``anew``: whatever is remembered. OSError: it can't be read."""
    stat, key = path.stat(), str(path.resolve())
    if not _known:
        _known.update(_remembered())
    remembered = _known.get(key)
    if not anew and remembered is not None and remembered[:2] == (stat.st_size, stat.st_mtime_ns):
        return remembered[2]
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    remember(path, found)
    return found


def remember(path: Path, found: str) -> None:
    """Notes the sha256 of a file as it is now. OSError: it isn't there.

    A cache that can't be written costs time at the next start, nothing else.
    """
    stat = path.stat()
    _known[str(path.resolve())] = (stat.st_size, stat.st_mtime_ns, found)
    with contextlib.suppress(OSError, SurveilNavError):
        merged = _remembered() | _known
        with atomic_write(_file()) as file:
            file.write(msgspec.json.encode(merged))


def _file() -> Path:
    return cache_dir() / "models" / "digests.json"


def _remembered() -> Known:
    """What earlier processes worked out; nothing where the file is missing or damaged."""
    with contextlib.suppress(OSError, msgspec.DecodeError, SurveilNavError):
        return msgspec.json.decode(_file().read_bytes(), type=Known)
    return {}
