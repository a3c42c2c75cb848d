"""Presence: a node is there as long as the router holds its liveliness token."""

from __future__ import annotations

import threading
from typing import Any

import zenoh

from surveilnav.bus.connection import Connection
from surveilnav.contract import LIVELINESS


class Presence:
    """Says that a node is there, and knows who else is."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._watchers: dict[str, _Watcher] = {}

    def announce(self, kind: str, id: str) -> None:
        """Says that this node is there, until the connection closes."""
        token = LIVELINESS.format(building=self._connection.building, kind=kind, id=id)
        self._connection.keep(self._connection.session.liveliness().declare_token(token))

    def alive(self, kind: str) -> set[str]:
        """Ids of the nodes of a kind that are here now. The first call starts watching."""
        watcher = self._watchers.get(kind)
        if watcher is None:
            watcher = self._watchers[kind] = _Watcher(self._connection, kind)
        return watcher.ids()

    def routers(self) -> int:
        """How many routers this process is connected to now."""
        return len(self._connection.session.info.routers_zid())


class _Watcher:
    """Keeps the set of living ids of one kind."""

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
        """Who is here now."""
        with self._lock:
            return set(self._ids)
