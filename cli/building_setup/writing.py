"""Writes all files or none."""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from surveilnav.errors import ConfigError
from surveilnav.storage import TEMPORARY


@dataclass(frozen=True, slots=True)
class NewFile:
    """A file to write. Containers run as another user, so all may read it and its folder, unless it is ``private``."""

    content: bytes
    private: bool = False


def refuse_existing(paths: list[Path]) -> None:
    """Raises ConfigError if one of the files is there already."""
    if there := [str(path) for path in paths if path.exists() or path.is_symlink()]:
        raise ConfigError(f"{', '.join(there)}: there already. --force replaces them, or name another folder")


def write_all(folder: Path, files: Mapping[str, NewFile]) -> None:
    """Writes files into a folder, which is made if it isn't there. If that fails or is interrupted, nothing has changed.

    Args:
        files: by their paths relative to the folder.

    Raises:
        ConfigError: there is a file in place of a folder.
        OSError: the folder or a file can't be written.
    """
    made: list[Path] = []
    waiting: dict[Path, Path] = {}
    try:
        for name, file in files.items():
            path = folder / name
            _make_folder(path.parent, made)
            handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=TEMPORARY)
            waiting[Path(temporary)] = path
            with os.fdopen(handle, "wb") as out:
                os.fchmod(out.fileno(), 0o600 if file.private else 0o644)
                out.write(file.content)
        with _uninterrupted():
            for temporary_path, path in waiting.items():
                os.replace(temporary_path, path)
    except BaseException:
        for temporary_path in waiting:
            temporary_path.unlink(missing_ok=True)
        for made_folder in reversed(made):
            with contextlib.suppress(OSError):
                made_folder.rmdir()
        raise


def _make_folder(folder: Path, made: list[Path]) -> None:
    if file := next((f for f in (folder, *folder.parents) if f.is_file()), None):
        raise ConfigError(f"{file} is a file; expected a folder")
    missing = [f for f in (folder, *folder.parents) if not f.exists()]
    for path in reversed(missing):
        path.mkdir()
        made.append(path)
        path.chmod(0o755)  # whatever the umask is


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C is only heeded afterwards."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread, which alone is interrupted
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
