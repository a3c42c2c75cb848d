"""The hashes that files have, and those that they should have.

Hashes of large files are computed once, and remembered by path, size and time of change. ``models.lock.json``, beside the
models, has the hashes that the first pull met: later content must have the same.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

import msgspec

from surveilnav.config import cache_dir
from surveilnav.errors import PerceptionError, SurveilNavError
from surveilnav.perception.models.catalogue import File, Model
from surveilnav.storage import atomic_write, file_lock

#: Size in bytes, time of change in nanoseconds and sha256, by path.
KnownHashes = dict[str, tuple[int, int, str]]
LOCK_NAME = "models.lock.json"

_known: KnownHashes = {}


# --- the hashes that files have -----------------------------------------------------------------------------------


def sha256(path: Path, *, anew: bool = False) -> str:
    """The sha256 of a file's content, in hex. OSError: it can't be read.

    ``anew`` computes it again, whatever is remembered.
    """
    stat, key = path.stat(), str(path.resolve())
    if not _known:
        _known.update(_remembered())
    known = _known.get(key)
    if not anew and known is not None and known[:2] == (stat.st_size, stat.st_mtime_ns):
        return known[2]
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    remember(path, found)
    return found


def remember(path: Path, found: str) -> None:
    """Remembers the sha256 of a file as it is now. OSError: it isn't there.

    Where the cache can't be written, the next process has to compute it again.
    """
    stat = path.stat()
    _known[str(path.resolve())] = (stat.st_size, stat.st_mtime_ns, found)
    with contextlib.suppress(OSError, SurveilNavError):
        merged = _remembered() | _known
        with atomic_write(_file()) as file:
            file.write(msgspec.json.encode(merged))


def _file() -> Path:
    return cache_dir() / "models" / "digests.json"


def _remembered() -> KnownHashes:
    """The hashes that earlier processes computed; empty where the file is missing or damaged."""
    with contextlib.suppress(OSError, msgspec.DecodeError, SurveilNavError):
        return msgspec.json.decode(_file().read_bytes(), type=KnownHashes)
    return {}


# --- the hashes that they should have -----------------------------------------------------------------------------


class LockEntry(msgspec.Struct, frozen=True):
    """What was pulled of one model. ``revision`` is the hub's commit, ``sha256`` is by file name."""

    source: str
    revision: str = ""
    sha256: dict[str, str] = {}


def read_lock(folder: Path) -> dict[str, LockEntry]:
    """The lock file of a folder of models; empty where there is none. PerceptionError: it is damaged."""
    path = folder / LOCK_NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, LockEntry])
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError, msgspec.DecodeError) as error:  # ValueError: bytes that aren't UTF-8
        raise PerceptionError(
            f"{path} should hold the hashes of pulled models, but can't be read ({error}). "
            "Remove it: the next pull trusts what it meets, and writes it anew."
        ) from error


def lock_entry(model: Model, folder: Path) -> LockEntry:
    """What was pulled of a model from its present source; an empty entry where nothing was."""
    entry = read_lock(folder).get(model.name)
    return entry if entry is not None and entry.source == model.source else LockEntry(model.source)


def write_lock_entry(model: Model, folder: Path, entry: LockEntry) -> None:
    """Replaces a model's entry in the lock file of a folder. OSError: as the disk does.

    Several models may be pulled at once, and the file is for all of them: it is locked between reading and writing.
    """
    with file_lock(folder / f".{LOCK_NAME}.held"), atomic_write(folder / LOCK_NAME) as file:
        file.write(msgspec.json.format(msgspec.json.encode(read_lock(folder) | {model.name: entry}), indent=2))


def expected_sha256(file: File | None, entry: LockEntry) -> str | None:
    """The sha256 that a file must have: the catalogue's, else that of the first pull; None where neither knows it."""
    return (file.sha256 or entry.sha256.get(file.name)) if file is not None else None
