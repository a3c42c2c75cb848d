"""The building's rooms, by the file of real cameras (``cameras.yaml``)."""

from __future__ import annotations

import threading
from pathlib import Path

import cv2
import numpy as np

from surveilnav.bus import Node
from surveilnav.cameras_file import load_cameras
from surveilnav.errors import ConfigError
from surveilnav.messages import Room
from surveilnav.storage import file_stamp


class Rooms:
    """Reads the rooms, and again after the file has changed. Thread-safe.

    Args:
        file: the file of cameras; None: no rooms are known.
    """

    def __init__(self, node: Node, file: Path | None) -> None:
        self._node, self._file = node, file
        self._stamp: tuple[int, ...] | None = None
        self._rooms: list[Room] = []
        self._lock = threading.Lock()

    def all(self, floor: str | None = None) -> list[Room]:
        """The rooms of a floor, or of all floors. While the file can't be read, those that it had before."""
        with self._lock:
            self._reload_if_changed()
            return [room for room in self._rooms if floor in (None, room.floor)]

    def name_at(self, floor: str, x_m: float, y_m: float) -> str:
        """The name of the room at a point [m, world]; "" if none is there."""
        for room in self.all(floor):
            if cv2.pointPolygonTest(np.array(room.outline_m, np.float32), (x_m, y_m), measureDist=False) >= 0:
                return room.name
        return ""

    def _reload_if_changed(self) -> None:
        if self._file is None:
            return
        try:
            if (stamp := file_stamp(self._file)) == self._stamp:
                return
            floors = load_cameras(self._file).floors
        except ConfigError as error:
            self._node.warn_seldom("rooms can't be read", file=str(self._file), error=str(error))
            return
        self._stamp = stamp
        self._rooms = [
            Room(floor=floor, name=name, outline_m=outline)
            for floor, entry in floors.items()
            for name, outline in entry.rooms.items()
        ]
