"""The file of a backup: a tar archive that begins with a description and ends with the checksum of every other file in it.

    surveilnav-backup.json    format, program, time, what is in it
    state/1f0c.../planner.sqlite
    ...
    checksums.json            SHA-256 by name

The archive isn't compressed, since nearly all of it is compressed pictures.
"""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Any

from surveilnav.errors import ConfigError

FORMAT = 1
_HEAD, _SUMS = "surveilnav-backup.json", "checksums.json"
_CHUNK_BYTES = 1 << 20
_MAX_HEAD_BYTES, _MAX_SUMS_BYTES = 1 << 20, 64 << 20

#: Called with the number of bytes that were read or written just now.
OnBytes = Callable[[int], None]


class ArchiveWriter:
    """Writes an archive into ``file``. Call ``add`` for each file, then ``finish``."""

    def __init__(self, file: IO[bytes], description: dict[str, Any]) -> None:
        self._tar = tarfile.open(fileobj=file, mode="w|", format=tarfile.PAX_FORMAT)  # noqa: SIM115 - closed by `finish`
        self._sums: dict[str, str] = {}
        self._put(_HEAD, json.dumps({"format": FORMAT, **description}, indent=1).encode())

    def add(self, name: str, path: Path, mode: int, on_bytes: OnBytes) -> None:
        """Adds a file, with the rights ``mode``. One that grows meanwhile is added as long as it was at first."""
        with path.open("rb") as file:
            member = self._tar.gettarinfo(arcname=name, fileobj=file)
            member.uname, member.gname, member.mode = "", "", mode & 0o777
            reader = _Hashing(file, on_bytes)
            self._tar.addfile(member, reader)  # type: ignore[arg-type]
        self._sums[name] = reader.sha256.hexdigest()

    def finish(self) -> None:
        self._put(_SUMS, json.dumps(self._sums, indent=1).encode())
        self._tar.close()

    def _put(self, name: str, data: bytes) -> None:
        member = tarfile.TarInfo(name)
        member.size, member.mode = len(data), 0o600
        self._tar.addfile(member, io.BytesIO(data))
        self._sums[name] = hashlib.sha256(data).hexdigest()


class _Hashing:
    """A file whose bytes are hashed as they are read."""

    def __init__(self, file: IO[bytes], on_bytes: OnBytes) -> None:
        self._file, self._on_bytes, self.sha256 = file, on_bytes, hashlib.sha256()

    def read(self, n: int = -1) -> bytes:
        data = self._file.read(n)
        self.sha256.update(data)
        self._on_bytes(len(data))
        return data


class ArchiveReader:
    """Reads the archive at ``path``. ``description``: as it was written."""

    def __init__(self, path: Path, tar: tarfile.TarFile) -> None:
        self._path, self._tar = path, tar
        self._sums: dict[str, str] = {}
        head = self._next()
        if head is None or head.name != _HEAD or not head.isreg() or head.size > _MAX_HEAD_BYTES:
            raise ConfigError(_foreign(path))
        self.description = self._json(head)
        if (found := self.description.get("format")) != FORMAT:
            raise ConfigError(f"{path} is a backup of format {found!r:.20}; this program reads format {FORMAT}")

    def extract(self, folder: Path | None, on_bytes: OnBytes) -> list[str]:
        """Reads the whole archive and compares it with its checksums; returns the names of the files in it.

        Args:
            folder: where the files are written; None: nowhere.

        Raises:
            ConfigError: it is damaged. What was written until then is to be thrown away.
        """
        names: list[str] = []
        while (member := self._next()) is not None:
            if member.name == _SUMS and member.size <= _MAX_SUMS_BYTES:
                self._compare(self._json(member))
                return names
            if not member.isreg() or member.issparse() or not _is_harmless(member.name) or member.name in self._sums:
                raise ConfigError(f"{self._path} has something in it that no backup has: {member.name!r:.80}")
            names.append(member.name)
            self._extract(member, folder, on_bytes)
        raise ConfigError(f"{self._path} is damaged: it is cut off. Nothing was restored")

    def _extract(self, member: tarfile.TarInfo, folder: Path | None, on_bytes: OnBytes) -> None:
        sha256 = hashlib.sha256()
        target = folder / member.name if folder else None
        if target is not None:
            target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with open(target or "/dev/null", "wb") as out:
            for data in self._chunks(member):
                sha256.update(data)
                on_bytes(len(data))
                out.write(data)
        if target is not None:
            target.chmod(member.mode & 0o777)
        self._sums[member.name] = sha256.hexdigest()

    def _compare(self, expected: dict[str, Any]) -> None:
        wrong = [name for name in {**self._sums, **expected} if self._sums.get(name) != expected.get(name)]
        if wrong:
            raise ConfigError(f"{self._path} is damaged: {sorted(wrong)[0]} isn't what was saved. Nothing was restored")

    def _json(self, member: tarfile.TarInfo) -> dict[str, Any]:
        data = b"".join(self._chunks(member))
        if member.name == _HEAD:
            self._sums[_HEAD] = hashlib.sha256(data).hexdigest()
        try:
            found = json.loads(data)
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise ConfigError(f"{self._path} is damaged: {member.name} can't be read. Nothing was restored")
        return found

    def _chunks(self, member: tarfile.TarInfo) -> Iterator[bytes]:
        with damage_named(self._path):
            file = self._tar.extractfile(member)
            assert file is not None, "only regular files are read"
            while data := file.read(_CHUNK_BYTES):
                yield data

    def _next(self) -> tarfile.TarInfo | None:
        with damage_named(self._path):
            return self._tar.next()


@contextmanager
def open_archive(path: Path) -> Iterator[ArchiveReader]:
    """An archive to read. ConfigError: the file is no backup, of another format, or damaged."""
    try:
        tar = tarfile.open(path, "r|")  # noqa: SIM115 - closed below
    except tarfile.TarError as error:
        raise ConfigError(_foreign(path)) from error
    with tar:
        yield ArchiveReader(path, tar)


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Turns what ``tarfile`` raises on damaged bytes into an error for people."""
    try:
        yield
    except (tarfile.TarError, EOFError, ValueError, OverflowError) as error:
        raise ConfigError(f"{path} is damaged: {error}. Nothing was restored") from error


def _foreign(path: Path) -> str:
    return f"{path} is no backup of SurveilNav: `surveilnav backup FILE` makes one"


def _is_harmless(name: str) -> bool:
    """Whether a name stays within the folder into which it is extracted."""
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and len(path.parts) > 1 and "\0" not in name
