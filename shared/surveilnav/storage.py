"""Files that are whole or not there: parts with a checksum, written under another name and renamed; and folders of them that
stay under a size."""

from __future__ import annotations

import contextlib
import hashlib
import os
import struct
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, TypeVar

try:
    import fcntl
except ImportError:  # not a POSIX system: work may be done twice, never wrongly
    fcntl = None  # type: ignore[assignment]


T = TypeVar("T")

#: How names of files end that are being written.
PART = ".part"
#: Of a cache's room: written by one process between two looks at the whole folder.
_RECOUNT = 0.02
_ABANDONED_S = 3600.0


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[IO[bytes]]:
    """A file to write that becomes ``path`` when all is written, and leaves nothing if that fails."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=PART)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_parts(path: Path, kind: bytes, parts: Sequence[bytes]) -> int:
    """Writes ``parts`` to ``path`` at once; returns the size of the file. Raises OSError as the disk does."""
    body = struct.pack(f"<I{len(parts)}Q", len(parts), *map(len, parts)) + b"".join(parts)
    with atomic_write(path) as file:
        file.write(kind + b"\n" + hashlib.sha256(body).digest() + body)
    return len(kind) + 33 + len(body)


def read_parts(path: Path, kind: bytes) -> list[bytes] | None:
    """The parts of a file that ``write_parts`` wrote; None if it isn't there or is damaged (then it is deleted)."""
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
    """What was made before and can be made again: an entry a file, at most ``max_bytes`` in all.

    The least recently used go first. Any number of processes may share a folder; each sees what the others kept. Each looks
    how much lies there after every fiftieth of the room that it writes: so far each may go beyond.
    """

    def __init__(self, folder: Path, kind: bytes, suffix: str, max_bytes: int) -> None:
        """``kind``: of its files, as ``write_parts`` takes it; ``suffix``: of their names, with its dot."""
        if max_bytes <= 0:
            raise ValueError(f"a cache needs room, got max_bytes={max_bytes}")
        self._folder, self._kind, self._suffix, self._max_bytes = folder, kind, suffix, max_bytes
        self._unseen = 0

    def path_of(self, key: str) -> Path:
        """The file of an entry. ``key``: a hash in hex."""
        return self._folder / key[:2] / f"{key[2:]}{self._suffix}"

    def get(self, key: str) -> list[bytes] | None:
        """The parts of an entry; None: there is none. It counts as used."""
        path = self.path_of(key)
        parts = read_parts(path, self._kind)
        if parts is not None:
            with contextlib.suppress(OSError):
                os.utime(path)  # the modification time is the time of last use
        return parts

    def read(self, key: str, of_parts: Callable[[list[bytes]], T], *errors: type[Exception]) -> T | None:
        """What ``of_parts`` makes of an entry; None: there is none, or it raised one of ``errors`` and the entry is dropped."""
        parts = self.get(key)
        if parts is None:
            return None
        try:
            return of_parts(parts)
        except errors:
            self.drop(key)
            return None

    def put(self, key: str, parts: Sequence[bytes]) -> None:
        """Keeps an entry. A full or read-only disk keeps nothing, and nothing fails."""
        with contextlib.suppress(OSError):
            self._unseen += write_parts(self.path_of(key), self._kind, parts)
            if self._unseen > _RECOUNT * self._max_bytes:
                self._unseen = 0
                self._shrink(keep=self.path_of(key))

    def drop(self, key: str) -> None:
        """Forgets an entry that turned out to be wrong."""
        with contextlib.suppress(OSError):
            self.path_of(key).unlink(missing_ok=True)

    def _shrink(self, keep: Path) -> None:
        """Deletes the least recently used entries until 90 % of the room is taken, whoever wrote them; and what writers that
        were killed left behind."""
        entries = []
        for path in self._folder.glob("*/*"):
            with contextlib.suppress(FileNotFoundError):
                stat = path.stat()
                if path.suffix == self._suffix:
                    entries.append((stat.st_mtime_ns, str(path), stat.st_size))
                elif path.suffix == PART and time.time() - stat.st_mtime > _ABANDONED_S:
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
    """Holds ``path`` against other processes, so that costly work is done once. Released if the process dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as file:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
