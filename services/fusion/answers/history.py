"""Answers to who wants to make the same maps again: the log of views, and the maps as they are."""

from __future__ import annotations

import threading

import msgspec

from surveilnav.bus import Answer, Refused, Request, clock_ns
from surveilnav.messages import LoggedView, MapSnapshot
from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.snapshot import digest, pack
from surveilnav.services.fusion.map_log.journal import State
from surveilnav.services.fusion.map_log.log import DurableMap
from surveilnav.services.fusion.map_log.store import StoreError

_PIECE_BYTES = 8 << 20


class History:
    """Called from the threads that serve queries."""

    def __init__(self, config: FusionConfig, maps: DurableMap) -> None:
        self._config, self._maps = config.model_dump_json(), maps
        self._lock = threading.Lock()
        self._kept: tuple[MapSnapshot, bytes] | None = None

    def view(self, request: Request) -> Answer:
        """The first view in the log after number ``after`` that the maps have taken."""
        after = _number(request, "after")
        try:
            newest, found = self._maps.logged_after(after)
        except StoreError as error:
            raise Refused("store_down", f"the log of views can't be read: {error}") from error
        if found is None:
            return Answer(LoggedView(stamp_ns=clock_ns(), number=0, newest=newest))
        number, e = found
        view = LoggedView(
            stamp_ns=clock_ns(),
            number=number,
            newest=newest,
            source=e.source,
            view=e.view,
            header=e.header,
            reply=e.reply,
            digest=e.digest,
            fault=e.fault,
        )
        return Answer(view, e.payload)

    def snapshot(self, request: Request) -> Answer:
        """The maps as they are now, from their first piece on; the other pieces of those with ``number``."""
        if request.parameters.get("only") == "digest":
            number, state = self._maps.frozen()
            return Answer(self._header(number, state))
        offset = _number(request, "offset")
        with self._lock:
            if offset == 0:
                number, state = self._maps.frozen()
                data = pack(state)
                self._kept = msgspec.structs.replace(self._header(number, state), n_bytes=len(data)), data
            if self._kept is None or (offset and self._kept[0].number != _number(request, "number")):
                raise Refused("gone", "these maps aren't kept any more: ask from offset 0 again")
            header, data = self._kept
            piece = data[offset : offset + _PIECE_BYTES]
            if offset + len(piece) >= len(data):
                self._kept = None
        return Answer(msgspec.structs.replace(header, offset=offset), piece)

    def _header(self, number: int, state: State) -> MapSnapshot:
        maps = state["maps"]
        revision = maps["maps"]["revision"]
        return MapSnapshot(
            stamp_ns=clock_ns(), number=number, revision=revision, digest=digest(maps), config=self._config
        )


def _number(request: Request, name: str) -> int:
    """A parameter that is a number from 0 on, 0 if it isn't there."""
    said = request.parameters.get(name, "0")
    if not (said.isascii() and said.isdigit() and len(said) <= 16):
        raise Refused("bad_number", f"expected {name}=NUMBER, from 0 on, got {said!r:.40}")
    return int(said)
