"""Requests to take what a source has contributed out of the maps again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from surveilnav.services.fusion.core.removal import Contribution

#: Of each source whose views maps have processed: the first and the last stamp of these views [ns].
Spans = Mapping[str, tuple[int, int]]

#: Stands in ``Spans`` for views of which it isn't known whose they were: the maps may hold something of any source.
ANY_SOURCE = "*"

Way = Literal["replay", "provenance"]
RemovalState = Literal["running", "done", "failed"]


@dataclass(frozen=True, slots=True)
class Removal:
    """A request to take what a source has contributed, always or within a time span, out of the maps.

    Attributes:
        id: 1, 2, ... in the order of the requests.
        number: log number of the newest view at the time of the request. Later views of the source stay.
        source: "camera/<id>" or "robot/<id>".
        since_ns, until_ns: the span of stamps [ns] that is removed, both included; None: without a limit.
        way: ``replay``: the maps are computed again from the log, without the views that are removed. ``provenance``: the log
            doesn't reach back far enough; what the source alone has seen is taken out of the maps as they are.
        requested_ns, finished_ns: when it was asked for, and done or given up; 0 until then.
        message: what was done, what remains, or why it failed; for people.
        quarantined: if the camera was removed because it isn't believed, what its views had shown (``Quarantine.state_of``).
    """

    id: int
    number: int
    source: str
    since_ns: int | None
    until_ns: int | None
    way: Way
    requested_ns: int
    state: RemovalState = "running"
    message: str = ""
    finished_ns: int = 0
    quarantined: dict[str, Any] | None = None

    @property
    def contribution(self) -> Contribution:
        """What is to be removed."""
        return Contribution(self.source, self.since_ns, self.until_ns)

    def includes(self, source: str, stamp_ns: int) -> bool:
        """Whether a view of a source that was taken at a time [ns] is to be removed."""
        return self.contribution.includes(source, stamp_ns)

    def may_touch(self, spans: Spans) -> bool:
        """Whether maps that have processed views of these spans may hold any view that is to be removed."""
        if ANY_SOURCE in spans:
            return True
        if self.source not in spans:
            return False
        return self.contribution.overlaps(*spans[self.source])


@dataclass(frozen=True, slots=True)
class SnapshotContents:
    """What is known of a snapshot without reading it.

    Attributes:
        removals: id of the newest removal that its maps reflect, as all before; 0: none.
        spans: whose views its maps have processed.
    """

    removals: int = 0
    spans: Spans = field(default_factory=lambda: {ANY_SOURCE: (0, 0)})

    def is_free_of(self, removals: Iterable[Removal]) -> bool:
        """Whether its maps hold nothing of what removals take away by replay, or don't hold it any more."""
        return not any(r.id > self.removals and r.way == "replay" and r.may_touch(self.spans) for r in removals)
