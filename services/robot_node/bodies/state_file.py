"""Where the simulated robot stands, on disk: after a restart it goes on from there, as a real robot would."""

from __future__ import annotations

from pathlib import Path

import msgspec
import structlog

from surveilnav.robot_state import RobotState
from surveilnav.storage import read_parts, write_parts

_FORMAT = b"surveilnav robot 1"


class _SavedState(msgspec.Struct, frozen=True):
    begun: str
    state: RobotState


class StateFile:
    """Holds the newest state of one robot.

    ``origin`` identifies the building and the start that the robot's states belong to: a file of another origin is ignored.
    ``problem``: why the newest state couldn't be saved, as a sentence for people; "" if it was.
    """

    def __init__(self, path: Path, origin: str) -> None:
        self._path, self._origin = path, origin
        self._log = structlog.get_logger()
        self.problem = ""

    def load(self) -> RobotState | None:
        """The state that was saved last; None if there is no file, it can't be read, or it is of another origin."""
        parts = read_parts(self._path, _FORMAT)
        if not parts:
            return None
        try:
            saved = msgspec.msgpack.decode(parts[0], type=_SavedState)
        except msgspec.MsgspecError:  # written by another version of the program
            return None
        return saved.state if saved.begun == self._origin else None

    def save(self, state: RobotState) -> None:
        """Replaces the file as a whole. If the disk is full the robot goes on, and its state is lost with the process."""
        saved = _SavedState(self._origin, state)
        data = msgspec.msgpack.encode(saved, enc_hook=lambda number: number.item())  # the hook is for numpy's numbers
        try:
            write_parts(self._path, _FORMAT, [data])
            self.problem = ""
        except OSError as error:
            if not self.problem:
                self._log.warning("the robot's state can't be saved", path=str(self._path), error=str(error))
            self.problem = f"where it stands can't be saved: {error}"
