"""Which recordings are deleted, so that the others stay within their limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecordingFileInfo:
    """A file in the folder of recordings.

    Attributes:
        id: the recording's id.
        n_bytes: its size.
        started_ns: when the recording, and so its oldest picture, began.
        is_open: it is being written. ``changed_ns``: when it was written last.
    """

    id: str
    n_bytes: int
    started_ns: int
    is_open: bool = False
    changed_ns: int = 0


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the folder; 0: no limit.

    ``n_bytes``: size of all files together, those that are being written included. ``age_ns``: time since a recording began.
    """

    n_bytes: int
    age_ns: int


def files_to_delete(files: Iterable[RecordingFileInfo], limits: Limits, now_ns: int) -> list[str]:
    """The ids of the files to delete, oldest first; never one that is being written."""
    files = sorted(files, key=lambda f: (f.started_ns, f.id))
    total = sum(f.n_bytes for f in files)
    deleted = []
    for file in files:
        if file.is_open:
            continue
        too_old = limits.age_ns > 0 and now_ns - file.started_ns > limits.age_ns
        too_much = 0 < limits.n_bytes < total
        if too_old or too_much:
            deleted.append(file.id)
            total -= file.n_bytes
    return deleted
