"""Which nodes are present: those whose liveliness token the router holds."""

from __future__ import annotations

import threading
from typing import Any

import zenoh

from surveilnav.bus.connection import Connection
from surveilnav.contract import LIVELINESS


class Presence:
    """Announces nodes of this process, and knows which others are present."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._watchers: dict[str, _Watcher] = {}

    def announce(self, kind: str, id: str) -> None:
        """Announces a node until the connection closes."""
        token = LIVELINESS.format(building=self._connection.building, kind=kind, id=id)
        self._connection.keep(self._connection.session.liveliness().declare_token(token))

    def alive(self, kind: str) -> set[str]:
        """Ids of the nodes of a kind that are present now. The first call for a kind subscribes to its changes."""
        watcher = self._watchers.get(kind)
        if watcher is None:
            watcher = self._watchers[kind] = _Watcher(self._connection, kind)
        return watcher.ids()

    def routers(self) -> int:
        """Number of routers that this process is connected to now."""
        return len(self._connection.session.info.routers_zid())


class _Watcher:
    """The ids of the present nodes of one kind."""

    def __init__(self, connection: Connection, kind: str) -> None:
        self._connection = connection
        self._ids: set[str] = set()
        self._lock = threading.Lock()
        pattern = LIVELINESS.format(building=connection.building, kind=kind, id="*")
        liveliness = connection.session.liveliness()
        self._subscriber = liveliness.declare_subscriber(pattern, self._on_change, history=True)
        for reply in liveliness.get(pattern, timeout=1.0):
            if reply.ok is not None:
                self._on_change(reply.ok)

    def _on_change(self, sample: Any) -> None:
        id = str(sample.key_expr).rsplit("/", 1)[1]
        with self._lock:
            (self._ids.add if sample.kind == zenoh.SampleKind.PUT else self._ids.discard)(id)
        self._connection.wake.set()

    def ids(self) -> set[str]:
        """A copy of the present ids."""
        with self._lock:
            return set(self._ids)
