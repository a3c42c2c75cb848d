"""Files that are whole or not there: parts with a checksum, written under another name and renamed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import struct
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # not a POSIX system: work may be done twice, never wrongly
    fcntl = None  # type: ignore[assignment]


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """A file to write that becomes ``path`` when all is written, and leaves nothing if that fails."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
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
    with replacing(path) as file:
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


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Holds ``path`` against other processes, so that costly work is done once. Released if the process dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as file:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
