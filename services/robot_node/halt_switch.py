"""The robot's halt, kept on disk: a robot that somebody stopped by hand stays stopped when its process restarts."""

from __future__ import annotations

from pathlib import Path

import structlog

from surveilnav.services.robot_node.core import HaltState
from surveilnav.storage import read_parts, write_parts

_FORMAT = b"surveilnav halt 1"
_MAX_REASON_CHARS = 200


class HaltSwitch:
    """Whether the robot is halted now (``state``), and the file ``<store>.halted`` that exists as long as it is.

    Without a ``store`` the halt ends with the process. ``notes`` says that the file isn't as it should be; empty if it is.
    """

    def __init__(self, store: str) -> None:
        self._path = Path(f"{store}.halted") if store else None
        self._log = structlog.get_logger()
        self.state = self._load()
        self.notes: list[str] = []

    def _load(self) -> HaltState:
        parts = read_parts(self._path, _FORMAT) if self._path else None
        return HaltState(True, parts[0].decode(errors="replace")) if parts else HaltState()

    def set(self, halted: bool, reason: str) -> None:
        """Halts or releases the robot. It is halted even if the disk is full; only a restart would release it then."""
        self.state = HaltState(halted, reason[:_MAX_REASON_CHARS] if halted else "")
        self._save()

    def retry_saving(self) -> None:
        """Writes the state again if that failed."""
        if self.notes:
            self._save()

    def _save(self) -> None:
        if self._path is None:
            return
        try:
            if self.state.halted:
                write_parts(self._path, _FORMAT, [self.state.reason.encode(errors="replace")])
            else:
                self._path.unlink(missing_ok=True)
            self.notes = []
        except OSError as error:
            if not self.notes:
                self._log.warning("the halt can't be written to disk", path=str(self._path), error=str(error))
            self.notes = [f"whether it is halted can't be saved, a restart would forget it: {error}"]
