"""A file that keeps where a simulated robot stands: a real one doesn't go back to its start when its process dies."""

from __future__ import annotations

from pathlib import Path

import msgspec
import structlog

from surveilnav.services.robot_node.core import RobotState
from surveilnav.stored import read_parts, write_parts

_FORMAT = b"surveilnav robot 1"


class _Kept(msgspec.Struct, frozen=True):
    begun: str
    state: RobotState


class KeptState:
    """The newest state of one robot in ``path``. ``begun`` names the building and the start that it belongs to."""

    def __init__(self, path: Path, begun: str) -> None:
        self._path, self._begun = path, begun
        self._log = structlog.get_logger()

    def load(self) -> RobotState | None:
        """The state that was last saved; None: there is none, it can't be read, or it belongs elsewhere."""
        parts = read_parts(self._path, _FORMAT)
        if not parts:
            return None
        try:
            kept = msgspec.msgpack.decode(parts[0], type=_Kept)
        except msgspec.MsgspecError:  # another version of the program wrote it
            return None
        return kept.state if kept.begun == self._begun else None

    def save(self, state: RobotState) -> None:
        """Writes it, whole or not at all. A disk that is full stops no robot: then it won't outlive its process."""
        data = msgspec.msgpack.encode(_Kept(self._begun, state), enc_hook=lambda number: number.item())  # numpy's
        try:
            write_parts(self._path, _FORMAT, [data])
        except OSError as error:
            self._log.warning("where the robot stands can't be kept", path=str(self._path), error=str(error))
