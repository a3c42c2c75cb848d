"""Computes the maps again without what was removed, on a thread, while the present maps serve queries and take new views."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

from surveilnav.bus import Node
from surveilnav.services.fusion.building_maps import BuildingMaps, Outcome
from surveilnav.services.fusion.map_log.recovery import replay, restore_snapshot
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.map_log.store import Store, StoredEvent
from surveilnav.services.fusion.perceived import PerceivedView

_POLL_S = 0.02  # between two looks for new views
#: So few views the main loop integrates itself, so that the new maps aren't always a view behind.
_MAX_LAST_VIEWS = 4
#: ... and one more each time that so long has passed, so that it ends even where views come as fast as they are integrated.
_PATIENCE_S = 5.0


class MapRebuild:
    """Maps that are computed from the log until they have processed all that the present maps have.

    Attributes:
        maps: the new maps; nobody else uses them before ``is_complete``.
        events: what happened to objects in them, since ``begin_number``.
        begin_number: log number of the snapshot that they began with.
        n_views: number of views that were processed so far.
        by_provenance: whether no snapshot without the source could be read, so that it was removed by provenance.
        error: why they can't be computed; None if they can.
    """

    def __init__(self, store: Store, node: Node, present: BuildingMaps, removals: Sequence[Removal]) -> None:
        """``present``: the maps that are in use. ``removals``: all of the file, oldest first."""
        self._store, self._node, self._present, self._removals = store, node, present, list(removals)
        self._lock = threading.Lock()  # held while views are integrated
        self._stopping, self._began_s = threading.Event(), time.monotonic()
        self.maps = BuildingMaps(present.joint.config)
        self.events: list[StoredEvent] = []
        self.begin_number: int | None = None
        self.n_views, self.by_provenance = 0, False
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="rebuild maps", daemon=True)
        self._thread.start()

    def is_complete(self) -> bool:
        """Whether the new maps have processed all that the present maps have. The main loop asks, which alone adds views.

        If only a few views are missing, they are integrated before it returns.
        """
        behind = self._present.number - self.maps.number
        max_behind = _MAX_LAST_VIEWS + (time.monotonic() - self._began_s) / _PATIENCE_S
        if self.error is not None or self.begin_number is None or behind > max_behind:
            return False
        with self._lock:
            self._catch_up()
            return self.error is None

    def close(self) -> None:
        """Stops the thread."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            with self._lock:
                possible = restore_snapshot(self._store, self._node, self.maps, self._removals)
                self.by_provenance, self._removals = possible != self._removals, possible
                self.begin_number = self.maps.number
        except Exception as error:
            self.error = error
            return
        while not self._stopping.is_set() and self.error is None:
            with self._lock:
                more = self._catch_up(max_views=1)
            if not more:
                self._stopping.wait(_POLL_S)

    def _catch_up(self, max_views: int | None = None) -> bool:
        """Integrates views, at most ``max_views``; returns whether there may be more. The caller holds the lock."""
        if self.error is not None:
            return False
        up_to = self._present.number
        try:
            for k, _ in enumerate(
                replay(self._store, self._node, self.maps, self._removals, self._integrate, up_to), 1
            ):
                self.n_views += 1
                if k == max_views:
                    return True
        except Exception as error:
            self.error = error
        return False

    def _integrate(self, number: int, perceived: PerceivedView) -> Outcome:
        outcome = self.maps.integrate(perceived, number)
        self.events += stored_events(number, outcome)
        return outcome


def stored_events(number: int, outcome: Outcome) -> list[StoredEvent]:
    """The events of objects that a view with a log number has caused."""
    return [
        StoredEvent(number, k, outcome.floor, change.object_id, change.absorbed, change.event)
        for k, change in enumerate(outcome.changes)
    ]
