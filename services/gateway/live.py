"""How everything in the building is right now, for streams: computed once, whoever watches."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Mapping

from pydantic import BaseModel

from surveilnav.bus import Node
from surveilnav.services.gateway.core.board import Board
from surveilnav.services.gateway.feed import Feed

#: So often all is compared with what was shown.
_LOOK_S = 0.5
#: Things by id.
Things = Mapping[str, BaseModel]


class Live(Feed):
    """A board of resources, kept by a thread of its own until the node ends, while anybody watches.

    ``sources``: by kind, what gives all resources of it. A resource is shown again if anything but ``last_seen`` changed.
    """

    beat_s = 5.0
    beat = "event: beat\ndata: {}\n"

    def __init__(self, node: Node, sources: Mapping[str, Callable[[], Things]]) -> None:
        self._board = Board(uuid.uuid4().hex[:8])
        super().__init__(self._board)
        self._node, self._sources = node, sources
        self._shown: dict[str, dict[str, tuple[BaseModel, str]]] = {kind: {} for kind in sources}
        threading.Thread(target=self._run, name="live", daemon=True).start()

    def _run(self) -> None:
        while not self._node.stopping.wait(_LOOK_S):
            for kind, source in self._sources.items() if self.streams else ():
                try:
                    self._show(kind, source())
                except Exception:  # a bug must not freeze what people see in silence
                    if not self._node.stopping.is_set():
                        self._node.log.exception("can't show what is there", kind=kind)

    def _show(self, kind: str, things: Things) -> None:
        """Compares all of a kind with what was shown; who isn't there any more is gone."""
        shown, news = self._shown[kind], dict.fromkeys(self._shown[kind].keys() - things.keys())
        changed: dict[str, str | None] = dict(news)
        for id, thing in things.items():
            known = shown.get(id)
            if known is not None and known[0] is thing:
                continue
            timeless = thing.model_dump_json(exclude={"last_seen"})
            if known is None or known[1] != timeless:
                changed[id] = thing.model_dump_json()
            shown[id] = thing, timeless
        for id in news:
            del shown[id]
        if changed:
            with self._lock:
                for id, state in changed.items():
                    self._board.show(kind, id, state)
                self._wake()
