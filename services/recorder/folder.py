"""The folder of recordings: listing, reading and deleting them. Files with other names aren't touched."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from surveilnav.bus import Refused
from surveilnav.messages import Recording
from surveilnav.services.recorder.core.limits import Limits, RecordingFileInfo, files_to_delete
from surveilnav.services.recorder.core.names import SUFFIX, parse_recording_id
from surveilnav.services.recorder.reading import cameras_of_complete, target_of

try:
    import fcntl
except ImportError:  # not a POSIX system: there nothing shows that a file is being written
    fcntl = None  # type: ignore[assignment]

_MAX_PART_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class _CacheEntry:
    """What was read from a file when it had this size. ``cameras``: those that it shows; None: it isn't complete.

    A file reaches its last size just before its writer lets go of it, so the size alone doesn't tell that it is complete.
    """

    n_bytes: int
    is_open: bool
    target: str
    cameras: list[str] | None


class RecordingFolder:
    """The folder of recordings. Safe to use from any thread; methods raise OSError when the disk does."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._cache: dict[str, _CacheEntry] = {}  # by id

    def path_of(self, id: str) -> Path:
        """The file of a recording. Raises Refused if the id can't be a recording's."""
        if parse_recording_id(id) is None:
            raise Refused(
                "unknown_recording", f"expected a recording's id, such as 20261125T143519250Z_m1, got {id!r:.120}"
            )
        return self.path / f"{id}{SUFFIX}"

    def files(self) -> list[RecordingFileInfo]:
        """The files of all recordings, newest first."""
        found = []
        for path in self.path.glob(f"*{SUFFIX}"):
            if (parts := parse_recording_id(path.stem)) is None:
                continue
            try:
                stat = path.stat()
                found.append(
                    RecordingFileInfo(path.stem, stat.st_size, parts[0], is_being_written(path), stat.st_mtime_ns)
                )
            except OSError:  # deleted meanwhile, or not readable: the others are listed all the same
                continue
        return sorted(found, key=lambda f: f.id, reverse=True)

    def recordings(self) -> list[Recording]:
        """All recordings, newest first, with what is in them."""
        return [self._recording(file) for file in self.files()]

    def enforce(self, limits: Limits, now_ns: int) -> list[str]:
        """Deletes the oldest recordings until the rest is within the limits; returns the ids of those deleted."""
        deleted = []
        for id in files_to_delete(self.files(), limits, now_ns):
            with suppress(
                OSError
            ):  # one that can't be deleted must keep neither the others nor the recorder from its work
                self.path_of(id).unlink(missing_ok=True)
                self._cache.pop(id, None)
                deleted.append(id)
        return deleted

    def delete(self, id: str) -> None:
        """Deletes a recording. Raises Refused if it doesn't exist or is being written."""
        path = self.path_of(id)
        if not path.exists():
            raise Refused("unknown_recording", f"there is no recording {id}")
        if is_being_written(path):
            raise Refused("recording", f"{id} is being written: cancel its mission first, or wait for its end")
        path.unlink(missing_ok=True)
        self._cache.pop(id, None)

    def read(self, id: str, offset: int, n_bytes: int) -> tuple[bytes, int]:
        """(at most ``n_bytes`` bytes from ``offset`` on, size of the file). Raises Refused if the recording doesn't exist."""
        try:
            with self.path_of(id).open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                file.seek(max(0, offset))
                return file.read(max(0, min(n_bytes, _MAX_PART_BYTES))), size
        except FileNotFoundError:
            raise Refused("unknown_recording", f"there is no recording {id}") from None

    def free_bytes(self) -> int:
        self.path.mkdir(parents=True, exist_ok=True)
        return shutil.disk_usage(self.path).free

    def _recording(self, file: RecordingFileInfo) -> Recording:
        started_ns, mission = parse_recording_id(file.id) or (0, "")
        known = self._cache.get(file.id)
        if known is None or (known.n_bytes, known.is_open) != (file.n_bytes, file.is_open):
            path = self.path_of(file.id)
            cameras = None if file.is_open else cameras_of_complete(path)
            target = known.target if known and known.target else target_of(path)
            known = self._cache[file.id] = _CacheEntry(file.n_bytes, file.is_open, target, cameras)
        is_complete = known.cameras is not None
        return Recording(
            id=file.id,
            mission=mission,
            state="recording" if file.is_open else "complete" if is_complete else "interrupted",
            n_bytes=file.n_bytes,
            started_ns=started_ns,
            changed_ns=file.changed_ns,
            target=known.target,
            cameras=known.cameras,
        )


def is_being_written(path: Path) -> bool:
    """Whether a process is writing the file: it then holds a lock on it."""
    if fcntl is None:
        return False
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False
