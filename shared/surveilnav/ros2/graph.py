"""Who is on the wire: the nodes and endpoints whose liveliness tokens exist now."""

from __future__ import annotations

import threading
from collections.abc import Callable

from surveilnav.errors import WireError
from surveilnav.ros2.names import Entity, EntityKind


class Graph:
    """The entities that are present. Thread-safe. ``on_change``: called after each change, on the thread that made it."""

    def __init__(self, on_change: Callable[[], None] = lambda: None) -> None:
        self._entities: dict[str, Entity] = {}
        self._lock, self._on_change = threading.Lock(), on_change

    def update(self, token: str, *, present: bool) -> None:
        """Records that a token came or went. One that can't be read is ignored: other tools may have tokens of their own."""
        try:
            entity = Entity.from_token(token)
        except WireError:
            return
        with self._lock:
            if present:
                self._entities[token] = entity
            else:
                self._entities.pop(token, None)
        self._on_change()

    def entities(self) -> list[Entity]:
        """All, in the order of their tokens."""
        with self._lock:
            return [self._entities[token] for token in sorted(self._entities)]

    def endpoints(self, kind: EntityKind, name: str) -> list[Entity]:
        """Those of a kind, of the topic or service with that full name."""
        return [e for e in self.entities() if e.kind == kind and e.name == name]
