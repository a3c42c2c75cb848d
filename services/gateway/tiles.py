"""Small pictures of the views that somebody watches. Each is requested from its camera once for all viewers."""

from __future__ import annotations

import base64
import threading
import time
import uuid
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from surveilnav.bus import Node
from surveilnav.rest import Tile
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core.change_log import StateLog
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.stream_sources import StreamSource

#: A view is requested again after this time. That is often enough for people, and saves traffic.
PERIOD_S = 3.0
WIDTH_PX = 240
#: Maximum number of views in one stream. A page shows no more at once.
MAX_TILES = 32
_DUE_PERIOD_S = 0.25
#: Maximum number of threads that cameras without an answer can block.
_THREADS = 8


class CameraTiles(StreamSource):
    """The newest small picture of each watched view, by the id "camera/view". A thread requests them until the node ends."""

    def __init__(self, node: Node, cameras: Cameras) -> None:
        self._log = StateLog(uuid.uuid4().hex[:8])
        super().__init__(self._log)
        self._node, self._cameras = node, cameras
        self._n_wanting: Counter[str] = Counter()
        #: When a view is to be requested, for views that are wanted and aren't being requested now.
        self._due_s: dict[str, float] = {}
        threading.Thread(target=self._run, name="tiles", daemon=True).start()

    @contextmanager
    def wanting(self, ids: Sequence[str]) -> Iterator[None]:
        """While this context is open, these views are requested regularly."""
        with self._lock:
            for id in ids:
                if not self._n_wanting[id]:
                    self._due_s.setdefault(id, 0.0)
                self._n_wanting[id] += 1
        try:
            yield
        finally:
            with self._lock:
                self._n_wanting -= Counter(ids)
                for id in set(ids) - set(self._n_wanting):
                    self._due_s.pop(id, None)
                    self._log.update("tile", id, None)

    def _run(self) -> None:
        with ThreadPoolExecutor(_THREADS, thread_name_prefix="tile") as pool:
            while not self._node.stopping.wait(_DUE_PERIOD_S):
                for id in self._take_due():
                    pool.submit(self._request, id)

    def _take_due(self) -> list[str]:
        """Removes and returns the views that are due. A view becomes due again only after its request has ended."""
        now_s = time.monotonic()
        with self._lock:
            due = [id for id, due_s in self._due_s.items() if due_s <= now_s]
            for id in due:
                del self._due_s[id]
        return due

    def _request(self, id: str) -> None:
        """Requests a view from its camera, and adds its picture to the log, or the reason why there is none."""
        camera, _, number = id.rpartition("/")
        view = int(number)
        try:
            picture = self._cameras.thumbnail(camera, view, WIDTH_PX)
            tile = Tile(camera=camera, view=view, jpeg=base64.b64encode(picture).decode())
        except Problem as problem:
            tile = Tile(camera=camera, view=view, problem=problem.name, detail=problem.detail)
        except Exception:
            self._node.log.exception("can't ask for a tile", tile=id)
            tile = Tile(camera=camera, view=view, problem="failed", detail="the gateway's log says why")
        with self._lock:
            if id not in self._n_wanting:
                return
            self._due_s[id] = time.monotonic() + PERIOD_S
            if self._log.update("tile", id, tile.model_dump_json(exclude_none=True)):
                self._wake()
