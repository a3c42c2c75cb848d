"""Messages with which a source's contribution is taken out of the joint maps."""

from __future__ import annotations

from typing import Literal

from surveilnav.messages.base import Message


class RemoveFromMaps(Message, frozen=True, kw_only=True):
    """Asks fusion to take out of the maps what a source has contributed, so that they are as if it had never been there.

    Attributes:
        source: "camera/<id>" or "robot/<id>".
        since_ns, until_ns: only views with stamps from the one to the other, both included [ns since the epoch]; None: no limit.
    """

    source: str
    since_ns: int | None = None
    until_ns: int | None = None


class MapRemoval(Message, frozen=True, kw_only=True):
    """What has become of a ``RemoveFromMaps``. ``stamp_ns``: when it was asked for.

    Attributes:
        id: 1, 2, ... in the order of the requests; a new store of fusion counts anew.
        way: ``replay``: the maps are computed again without the views, and equal bit by bit those that never had them.
            ``provenance``: the log doesn't reach back far enough; what the source alone has seen is gone.
        views_done, views_total: while it runs, how many logged views of how many were processed.
        message: what was done, what remains, or why it failed; for people.
        finished_ns: when it ended; 0: it runs.
    """

    id: int
    source: str
    since_ns: int | None = None
    until_ns: int | None = None
    way: Literal["replay", "provenance"]
    state: Literal["running", "done", "failed"]
    views_done: int = 0
    views_total: int = 0
    message: str = ""
    finished_ns: int = 0


class MapRemovals(Message, frozen=True, kw_only=True):
    """The newest removals, oldest first."""

    removals: list[MapRemoval]
