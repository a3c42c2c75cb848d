"""Answers with logged views and snapshots of the maps, from which others (the recorder) can compute the same maps."""

from __future__ import annotations

import threading

import msgspec

from surveilnav.bus import Answer, Refused, Request, clock_ns
from surveilnav.messages import LoggedView, MapSnapshot
from surveilnav.services.fusion.answers.parameters import number_of
from surveilnav.services.fusion.building_maps import BuildingMaps, State
from surveilnav.services.fusion.core.snapshot import digest, pack
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.map_log.store import StoreError

_PIECE_BYTES = 8 << 20


class LogAnswers:
    """Answers queries for logged views and snapshots. Thread-safe."""

    def __init__(self, fusion: str, maps: BuildingMaps, log: MapLog) -> None:
        """``fusion``: the id of this service, by which queries to one of several address it."""
        self._fusion = fusion
        self._config, self._maps, self._log = maps.joint.config.model_dump_json(), maps, log
        self._lock = threading.Lock()
        self._snapshot: tuple[MapSnapshot, bytes] | None = None  # that a client is still fetching in pieces

    def view(self, request: Request) -> Answer | list[Answer]:
        """The first integrated view in the log after number ``after``."""
        if self._is_for_another(request):
            return []
        after = _number(request, "after")
        try:
            removals = self._maps.removals
            newest, number, e = self._log.next_view(after)
        except StoreError as error:
            raise Refused("store_down", f"the log of views can't be read: {error}") from error
        if e is None:
            return Answer(
                LoggedView(stamp_ns=clock_ns(), number=0, newest=newest, removals=removals, fusion=self._fusion)
            )
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
            removals=removals,
            fusion=self._fusion,
        )
        return Answer(view, e.payload)

    def snapshot(self, request: Request) -> Answer | list[Answer]:
        """A piece of a snapshot of the maps.

        Parameters: ``offset`` in bytes; 0 makes a new snapshot of the maps as they are now. Further pieces need the ``number`` of
        that snapshot. ``only=digest``: its digest alone, without any piece.
        """
        if self._is_for_another(request):
            return []
        if request.parameters.get("only") == "digest":
            return Answer(self._header(self._maps.freeze()))
        offset = _number(request, "offset")
        with self._lock:
            if offset == 0:
                state = self._maps.freeze()
                data = pack(state)
                self._snapshot = msgspec.structs.replace(self._header(state), n_bytes=len(data)), data
            if self._snapshot is None or (offset and self._snapshot[0].number != _number(request, "number")):
                raise Refused("gone", "these maps aren't kept any more: ask from offset 0 again")
            header, data = self._snapshot
            piece = data[offset : offset + _PIECE_BYTES]
            if offset + len(piece) >= len(data):
                self._snapshot = None
        return Answer(msgspec.structs.replace(header, offset=offset), piece)

    def _header(self, state: State) -> MapSnapshot:
        return MapSnapshot(
            stamp_ns=clock_ns(),
            number=state["number"],
            revision=state["maps"]["maps"]["revision"],
            digest=digest(state["maps"]),
            config=self._config,
            removals=state["removals"],
            fusion=self._fusion,
        )

    def _is_for_another(self, request: Request) -> bool:
        """Whether another fusion is asked. One that is asked for none in particular is the only one."""
        return request.parameters.get("fusion", self._fusion) != self._fusion


def _number(request: Request, name: str) -> int:
    """A parameter that is a non-negative number; 0 if it is missing. Refused: bad_number."""
    if name not in request.parameters:
        return 0
    number = number_of(request, name)
    if number is None:
        raise Refused("bad_number", f"expected {name}=NUMBER, from 0 on, got {request.parameters[name]!r:.40}")
    return number
