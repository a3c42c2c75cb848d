"""Small pictures of the cameras that somebody watches: asked of a camera once, whoever watches it."""

from __future__ import annotations

import base64
import json
import threading
import time
import uuid
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from surveilnav.bus import Node
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core.board import Board
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.feed import Feed

#: A view is asked for again after so long; traffic for people, so seldom.
PERIOD_S = 3.0
WIDTH_PX = 240
#: A stream names at most so many; a page shows no more at once.
MOST = 32
_LOOK_S = 0.25
#: Cameras that don't answer hold so many threads at most.
_AT_ONCE = 8


class Tiles(Feed):
    """A board of pictures, by "camera/view"; a thread asks for those that streams want, until the node ends."""

    def __init__(self, node: Node, cameras: Cameras) -> None:
        self._board = Board(uuid.uuid4().hex[:8])
        super().__init__(self._board)
        self._node, self._cameras = node, cameras
        self._wanted: Counter[str] = Counter()
        self._due_s: dict[str, float] = {}  # of what is wanted and isn't being asked for
        threading.Thread(target=self._run, name="tiles", daemon=True).start()

    @contextmanager
    def wanting(self, ids: Sequence[str]) -> Iterator[None]:
        """Has these views asked for, meanwhile."""
        with self._lock:
            for id in ids:
                self._due_s.setdefault(id, 0.0) if not self._wanted[id] else None
                self._wanted[id] += 1
        try:
            yield
        finally:
            with self._lock:
                self._wanted -= Counter(ids)
                for id in set(ids) - set(self._wanted):
                    self._due_s.pop(id, None)
                    self._board.show("tile", id, None)

    def _run(self) -> None:
        with ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="tile") as pool:
            while not self._node.stopping.wait(_LOOK_S):
                for id in self._due():
                    pool.submit(self._ask, id)

    def _due(self) -> list[str]:
        """What is to be asked for now; none of it is due until it was answered."""
        now_s = time.monotonic()
        with self._lock:
            due = [id for id, due_s in self._due_s.items() if due_s <= now_s]
            for id in due:
                del self._due_s[id]
        return due

    def _ask(self, id: str) -> None:
        """Asks a camera for a view, and shows it or why it can't be had."""
        camera, _, view = id.rpartition("/")
        state: dict[str, object]
        try:
            picture = self._cameras.thumbnail(camera, int(view), WIDTH_PX)
            state = {"jpeg": base64.b64encode(picture).decode()}
        except Problem as problem:
            state = {"problem": problem.name, "detail": problem.detail}
        except Exception:
            self._node.log.exception("can't ask for a tile", tile=id)
            state = {"problem": "failed", "detail": "the gateway's log says why"}
        with self._lock:
            if id not in self._wanted:
                return
            self._due_s[id] = time.monotonic() + PERIOD_S
            if self._board.show("tile", id, json.dumps(state | {"camera": camera, "view": int(view)})):
                self._wake()
