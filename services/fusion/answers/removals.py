"""Answers requests to take a source's contribution out of the maps, and publishes how far that is."""

from __future__ import annotations

import re
import time

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import ID, MAP_REMOVALS, REMOVE_FROM_MAPS
from surveilnav.messages import MapRemoval, MapRemovals, RemoveFromMaps
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.map_log.removals import Removals

_SOURCE = re.compile(f"(camera|robot)/{ID}")
_PERIOD_S = 0.5  # between two messages while nothing but the progress changes
_MAX_TOLD = 20
_MAX_STAMP_NS = 2**62


class RemovalAnswers:
    """Answers queries on threads of the node; ``publish`` is for the main loop."""

    def __init__(self, node: Node, removals: Removals) -> None:
        self._removals = removals
        self._publisher = node.publisher(MAP_REMOVALS, fusion=node.id)
        self._published: tuple[list[Removal], tuple[int, int]] = [], (0, 0)
        self._published_s = 0.0
        node.serve(REMOVE_FROM_MAPS, self.remove, fusion=node.id)
        node.serve(MAP_REMOVALS, lambda _: Answer(self._message()), fusion=node.id)

    def remove(self, request: Request) -> Answer:
        """Begins a removal. Refused: bad_source, bad_span, unknown_source, busy, or store_down."""
        wanted: RemoveFromMaps = request.message
        if _SOURCE.fullmatch(wanted.source) is None:
            raise Refused("bad_source", f"expected camera/ID or robot/ID, got {wanted.source!r:.80}")
        if any(abs(stamp_ns or 0) > _MAX_STAMP_NS for stamp_ns in (wanted.since_ns, wanted.until_ns)):
            raise Refused("bad_span", "expected stamps of at most 2^62 ns")
        if wanted.since_ns is not None and wanted.until_ns is not None and wanted.since_ns > wanted.until_ns:
            raise Refused("bad_span", "the end of the time span lies before its beginning")
        removal = self._removals.ask(wanted.source, wanted.since_ns, wanted.until_ns)
        return Answer(self._to_message(removal))

    def publish(self) -> None:
        """Publishes the removals when something has changed."""
        known, progress = list(self._removals.known), self._removals.progress
        if (known, progress) == self._published:
            return
        now_s = time.monotonic()
        if known == self._published[0] and now_s - self._published_s < _PERIOD_S:
            return
        self._published, self._published_s = (known, progress), now_s
        self._publisher.put(self._message())

    def _message(self) -> MapRemovals:
        newest = self._removals.known[-_MAX_TOLD:]
        return MapRemovals(stamp_ns=clock_ns(), removals=[self._to_message(removal) for removal in newest])

    def _to_message(self, r: Removal) -> MapRemoval:
        done, total = self._removals.progress if r.state == "running" else (0, 0)
        return MapRemoval(
            stamp_ns=r.requested_ns,
            id=r.id,
            source=r.source,
            since_ns=r.since_ns,
            until_ns=r.until_ns,
            way=r.way,
            state=r.state,
            views_done=done,
            views_total=total,
            message=r.message,
            finished_ns=r.finished_ns,
        )
