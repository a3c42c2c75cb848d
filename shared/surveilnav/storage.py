"""Files that are written atomically, files of several parts with a checksum, and a disk cache of such files."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import struct
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, TypeVar

try:
    import fcntl
except ImportError:  # not a POSIX system: processes may do the same work twice, which is harmless
    fcntl = None  # type: ignore[assignment]


T = TypeVar("T")

#: Suffix of files that are being written.
TEMPORARY = ".part"
#: Share of a cache's capacity that a process may write before it measures the folder again.
_RECOUNT = 0.02
#: Temporary files older than this were left by a process that was killed.
_ABANDONED_S = 3600.0


@contextlib.contextmanager
def atomic_write(path: Path, *, keep_mode: bool = False) -> Iterator[IO[bytes]]:
    """A temporary file that replaces ``path`` when the block ends, and is deleted if the block raises.

    Args:
        keep_mode: whoever may read the present file may read the new one; otherwise, only its owner may.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=TEMPORARY)
    try:
        with os.fdopen(handle, "wb") as file:
            if keep_mode:
                os.chmod(temporary, stat.S_IMODE(path.stat().st_mode))
            yield file
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def file_stamp(path: Path) -> tuple[int, ...]:
    """Changes whenever a file is written, replaced or given other rights; () while there is none."""
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode


def write_parts(path: Path, kind: bytes, parts: Sequence[bytes]) -> int:
    """Writes ``parts`` with a checksum to ``path``, atomically.

    Args:
        kind: identifies the file's format; the first line of the file.

    Returns:
        The size of the file.

    Raises:
        OSError: the file can't be written.
    """
    body = struct.pack(f"<I{len(parts)}Q", len(parts), *map(len, parts)) + b"".join(parts)
    with atomic_write(path) as file:
        file.write(kind + b"\n" + hashlib.sha256(body).digest() + body)
    return len(kind) + 33 + len(body)


def read_parts(path: Path, kind: bytes) -> list[bytes] | None:
    """The parts of a file written by ``write_parts``. None if there is no file, or if it was damaged; then it is deleted."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    head, body = data[: len(kind) + 33], data[len(kind) + 33 :]
    if head == kind + b"\n" + hashlib.sha256(body).digest():
        (count,) = struct.unpack_from("<I", body)
        sizes = struct.unpack_from(f"<{count}Q", body, 4)
        parts, begin = [], 4 + 8 * count
        for size in sizes:
            parts.append(body[begin : begin + size])
            begin += size
        return parts
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
    return None


class FolderCache:
    """A disk cache of at most ``max_bytes`` with one file per entry; the least recently used entries are evicted.

    Any number of processes may share a folder. Each measures the folder only after it has written a fiftieth of the capacity,
    by which it may exceed the limit meanwhile.
    """

    def __init__(self, folder: Path, kind: bytes, suffix: str, max_bytes: int) -> None:
        """``kind``: format of its files, see ``write_parts``; ``suffix``: suffix of their names, with the dot."""
        if max_bytes <= 0:
            raise ValueError(f"a cache needs room, got max_bytes={max_bytes}")
        self._folder, self._kind, self._suffix, self._max_bytes = folder, kind, suffix, max_bytes
        self._unmeasured_bytes = 0

    def path_for(self, key: str) -> Path:
        """The path of an entry. ``key``: a hash in hex."""
        return self._folder / key[:2] / f"{key[2:]}{self._suffix}"

    def get(self, key: str) -> list[bytes] | None:
        """The parts of an entry, which becomes the most recently used; None if there is none."""
        path = self.path_for(key)
        parts = read_parts(path, self._kind)
        if parts is not None:
            with contextlib.suppress(OSError):
                os.utime(path)  # the modification time is the time of last use
        return parts

    def read(self, key: str, parse: Callable[[list[bytes]], T], *errors: type[Exception]) -> T | None:
        """The parsed entry. None if there is none, or if ``parse`` raised one of ``errors``; then the entry is deleted."""
        parts = self.get(key)
        if parts is None:
            return None
        try:
            return parse(parts)
        except errors:
            self.drop(key)
            return None

    def put(self, key: str, parts: Sequence[bytes]) -> None:
        """Stores an entry. If the disk is full or read-only nothing is stored, and no error is raised."""
        with contextlib.suppress(OSError):
            self._unmeasured_bytes += write_parts(self.path_for(key), self._kind, parts)
            if self._unmeasured_bytes > _RECOUNT * self._max_bytes:
                self._unmeasured_bytes = 0
                self._shrink(keep=self.path_for(key))

    def drop(self, key: str) -> None:
        with contextlib.suppress(OSError):
            self.path_for(key).unlink(missing_ok=True)

    def _shrink(self, keep: Path) -> None:
        """Deletes the least recently used entries down to 90 % of the capacity, and abandoned temporary files."""
        entries = []
        for path in self._folder.glob("*/*"):
            with contextlib.suppress(FileNotFoundError):
                status = path.stat()
                if path.suffix == self._suffix:
                    entries.append((status.st_mtime_ns, str(path), status.st_size))
                elif path.suffix == TEMPORARY and time.time() - status.st_mtime > _ABANDONED_S:
                    path.unlink(missing_ok=True)
        total = sum(size for _, _, size in entries)
        if total <= self._max_bytes:
            return
        for _, name, size in sorted(entries):
            if total <= 0.9 * self._max_bytes:
                break
            if name == str(keep):
                continue
            Path(name).unlink(missing_ok=True)
            total -= size


@contextlib.contextmanager
def file_lock(path: Path) -> Iterator[None]:
    """Holds a lock on ``path`` against other processes. It is released if the process dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as file:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
