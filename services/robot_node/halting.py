"""Whether the robot was stopped by hand, kept beside its store: a process that dies and comes back releases nobody."""

from __future__ import annotations

from pathlib import Path

import structlog

from surveilnav.services.robot_node.core import Halted
from surveilnav.stored import read_parts, write_parts

_FORMAT = b"surveilnav halt 1"
_LONGEST_REASON = 200


class Halting:
    """The robot's halt, in ``store``.halted while it lasts; without a store it doesn't outlive the process."""

    def __init__(self, store: str) -> None:
        self._path = Path(f"{store}.halted") if store else None
        self._log = structlog.get_logger()
        self.now = self._kept()

    def _kept(self) -> Halted:
        parts = read_parts(self._path, _FORMAT) if self._path else None
        return Halted(True, parts[0].decode(errors="replace")) if parts else Halted()

    def set(self, halted: bool, reason: str) -> None:
        """Halts or releases. A disk that is full keeps no robot from being stopped."""
        self.now = Halted(halted, reason[:_LONGEST_REASON] if halted else "")
        if self._path is None:
            return
        try:
            if halted:
                write_parts(self._path, _FORMAT, [self.now.reason.encode(errors="replace")])
            else:
                self._path.unlink(missing_ok=True)
        except OSError as error:
            self._log.warning("whether the robot is halted can't be kept", path=str(self._path), error=str(error))
