"""The folder of recordings: what is in it, and what goes. Files of other names aren't touched."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from surveilnav.bus import Refused
from surveilnav.messages import Recording
from surveilnav.services.recorder.core.limits import Kept, Limits, to_delete
from surveilnav.services.recorder.core.names import ENDING, parts_of
from surveilnav.services.recorder.reading import cameras_in_whole, target_of

try:
    import fcntl
except ImportError:  # not a POSIX system: nothing there says that a file is being written
    fcntl = None  # type: ignore[assignment]

_MOST_PART_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class _Facts:
    """What a file of that size says. ``cameras``: those that it shows; None: it isn't whole, and nobody looked."""

    n_bytes: int
    target: str
    cameras: list[str] | None


class Folder:
    """May be used from any thread. OSError: the disk can't be read or written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._facts: dict[str, _Facts] = {}  # by id

    def file_of(self, id: str) -> Path:
        """Where a recording lies. Refused: it is no id of one."""
        if parts_of(id) is None:
            raise Refused(
                "unknown_recording", f"expected a recording's id, such as 20261125T143519250Z_m1, got {id!r:.120}"
            )
        return self.path / f"{id}{ENDING}"

    def kept(self) -> list[Kept]:
        """All recordings, newest first."""
        found = []
        for path in self.path.glob(f"*{ENDING}"):
            if (parts := parts_of(path.stem)) is None:
                continue
            try:
                at = path.stat()
                found.append(Kept(path.stem, at.st_size, parts[0], is_open(path), at.st_mtime_ns))
            except OSError:  # deleted meanwhile, or nothing that can be read: it must not cost the others
                continue
        return sorted(found, key=lambda f: f.id, reverse=True)

    def recordings(self) -> list[Recording]:
        """The same, with what is written in them."""
        return [self._recording(file) for file in self.kept()]

    def tidy(self, limits: Limits, now_ns: int) -> list[str]:
        """Deletes what is beyond the limits; returns the ids of those."""
        gone = []
        for id in to_delete(self.kept(), limits, now_ns):
            with suppress(
                OSError
            ):  # one that can't be deleted must not keep the others, nor stop what is to be written
                self.file_of(id).unlink(missing_ok=True)
                self._facts.pop(id, None)
                gone.append(id)
        return gone

    def delete(self, id: str) -> None:
        """Deletes one. Refused: it isn't there, or it is being written."""
        path = self.file_of(id)
        if not path.exists():
            raise Refused("unknown_recording", f"there is no recording {id}")
        if is_open(path):
            raise Refused("recording", f"{id} is being written: cancel its mission first, or wait for its end")
        path.unlink(missing_ok=True)
        self._facts.pop(id, None)

    def read(self, id: str, offset: int, n_bytes: int) -> tuple[bytes, int]:
        """(up to ``n_bytes`` from ``offset``, size of the file). Refused: it isn't there."""
        try:
            with self.file_of(id).open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                file.seek(max(0, offset))
                return file.read(max(0, min(n_bytes, _MOST_PART_BYTES))), size
        except FileNotFoundError:
            raise Refused("unknown_recording", f"there is no recording {id}") from None

    def free_bytes(self) -> int:
        """What is left on the disk."""
        self.path.mkdir(parents=True, exist_ok=True)
        return shutil.disk_usage(self.path).free

    def _recording(self, file: Kept) -> Recording:
        started_ns, mission = parts_of(file.id) or (0, "")
        facts = self._facts.get(file.id)
        if facts is None or facts.n_bytes != file.n_bytes:
            path = self.file_of(file.id)
            cameras = None if file.open else cameras_in_whole(path)
            target = facts.target if facts and facts.target else target_of(path)
            facts = self._facts[file.id] = _Facts(file.n_bytes, target, cameras)
        whole = facts.cameras is not None
        return Recording(
            id=file.id,
            mission=mission,
            state="recording" if file.open else "complete" if whole else "interrupted",
            n_bytes=file.n_bytes,
            started_ns=started_ns,
            changed_ns=file.changed_ns,
            target=facts.target,
            cameras=facts.cameras,
        )


def is_open(path: Path) -> bool:
    """Whether somebody writes the file."""
    if fcntl is None:
        return False
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False
