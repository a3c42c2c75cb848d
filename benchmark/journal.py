"""Files that grow by whole lines: several processes may write at once, and a kill loses no line that was written."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from surveilnav.storage import atomic_write

try:
    import fcntl
except ImportError:  # not a POSIX system: there one process at a time may write
    fcntl = None  # type: ignore[assignment]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Locks a journal against other writers while the context lasts. It can't be nested."""
    if fcntl is None:
        yield
        return
    folder = os.open(
        path.parent, os.O_RDONLY
    )  # the folder, because ``rewrite`` puts another file in the journal's place
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def append(path: Path, line: str) -> None:
    """Adds a line; when this returns, a kill can't lose it. A torn last line, of a writer that was killed, is cut off.

    Raises:
        OSError: as the disk does.
    """
    with locked(path), path.open("ab+") as file:
        end = file.seek(0, os.SEEK_END)
        file.truncate(end - _torn_bytes(path, end))
        file.write(line.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def lines(path: Path) -> list[str]:
    """All whole lines; a torn last one isn't there. Bytes that aren't text are replaced. Raises OSError."""
    return path.read_bytes().decode(errors="replace").split("\n")[:-1]


def rewrite(path: Path, new: Iterable[str]) -> None:
    """Puts other lines in a journal's place, all or none; to be called while it is ``locked``. Raises OSError."""
    with atomic_write(path) as file:
        os.fchmod(file.fileno(), 0o644)
        file.write("".join(f"{line}\n" for line in new).encode())
        file.flush()
        os.fsync(file.fileno())


def _torn_bytes(path: Path, size: int) -> int:
    """How long the last line is, if it has no end."""
    with path.open("rb") as file:
        if size == 0 or (file.seek(size - 1) and file.read(1) == b"\n"):
            return 0
        file.seek(0)
        return len(file.read().rpartition(b"\n")[2])
