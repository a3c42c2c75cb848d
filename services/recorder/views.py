"""Has every view that goes into the maps go into the recordings, too: all of them, in fusion's order, or it is said."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import VIEW_LOG
from surveilnav.errors import BusError
from surveilnav.services.recorder.core.drawer import Heard
from surveilnav.services.recorder.fusion import Fusion
from surveilnav.services.recorder.missions import Recorded
from surveilnav.services.recorder.scribe import Scribe

_AGAIN_S = 2.0  # before fusion is asked again after trouble
_MOST_AT_ONCE = 32  # before others have their turn


class Views:
    """Used by the loop alone. ``problem``: why no views are recorded; empty while all are."""

    def __init__(self, node: Node, fusion: Fusion, scribe: Scribe) -> None:
        self._node, self._fusion, self._scribe = node, fusion, scribe
        self.problem, self._again_s = "", 0.0

    def follow(self, recorded: Iterable[Recorded]) -> bool:
        """Brings the recordings up to fusion's newest view; True if there is more to bring."""
        following = list(recorded)
        if not following or time.monotonic() < self._again_s:
            return False
        try:  # those under way first: maps that can't be had for a new one must not cost them their views
            more, self.problem = self._bring(following), ""
            new = [r for r in following if r.number is None]
            if new and not self._scribe.is_attaching:
                self._begin(new)
                more = True
            return more
        except BusError as error:
            self.problem = f"views aren't recorded: {error}"
            self._again_s = time.monotonic() + _AGAIN_S
            self._node.warn_seldom("views aren't recorded", error=str(error))
            return False

    def end(self, one: Recorded) -> dict[str, str]:
        """Brings a recording to its end: what the maps come to, once it holds all that made them."""
        try:
            told = self._fusion.digest()
            until_s = time.monotonic() + _AGAIN_S
            while one.number is not None and one.number < told.number and time.monotonic() < until_s:
                self._bring([one], told.number)
            if one.number is not None and one.number >= told.number:
                return {"number": str(told.number), "revision": str(told.revision), "digest": told.digest}
        except BusError as error:
            self._node.warn_seldom("a recording lacks the end of its maps", error=str(error))
        return {}

    def _begin(self, recorded: Sequence[Recorded]) -> None:
        """The maps as they are now, once for all: a recording's views are what came after them."""
        header, data = self._fusion.snapshot()
        name = f"maps-{header.number}"
        self._scribe.attach(
            [one.id for one in recorded], name, data, {"config": header.config, "digest": header.digest}
        )
        for one in recorded:
            one.number = header.number

    def _bring(self, following: list[Recorded], up_to: int | None = None) -> bool:
        """A few views more, ``up_to`` that number; True if there may be others."""
        for _ in range(_MOST_AT_ONCE):
            behind = [r for r in following if r.number is not None and r.number != up_to]
            if not behind or not self._scribe.has_room:
                return False
            after = min(r.number for r in behind if r.number is not None)
            received = self._fusion.next_view(after)
            view = received.message
            if view.number == 0:
                if view.newest < after:  # fusion began anew
                    self._lost(behind)
                return False
            if view.number > after + 1:  # the recorder was away for too long, or the log is damaged
                self._lost([r for r in behind if r.number == after])
                continue
            ids = [r.id for r in behind if r.number == after]
            heard = Heard(VIEW_LOG, received.key, view, received.payload, clock_ns())
            if not self._scribe.hear(ids, heard):
                return False
            for one in behind:
                if one.number == after:
                    one.number = view.number
        return True

    def _lost(self, recorded: Iterable[Recorded]) -> None:
        """They go on from new maps."""
        for one in recorded:
            self._node.warn_seldom("views are missing from a recording", id=one.id, after=one.number)
            one.number = None
