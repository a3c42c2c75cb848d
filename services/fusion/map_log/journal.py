"""The write-ahead log of views, the snapshots of the maps, and the events of objects.

A view is logged before the maps take it. Whatever a revision or a reply says can therefore be made again: from the newest
snapshot that can be read, and the views logged since, in their order. What can't be read is said and set aside.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from surveilnav.bus import Node
from surveilnav.errors import WireError
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.messages.maps import ObjectEvent
from surveilnav.sensing.packing import decode_frame, perception_from_wire
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.objects.map_object import ObjectChange
from surveilnav.services.fusion.core.snapshot import SnapshotError, pack, unpack
from surveilnav.services.fusion.map_log.retention import LogAge
from surveilnav.services.fusion.map_log.store import Entry, Store, StoredEvent, StoreError
from surveilnav.services.fusion.records import PerceivedView

State = dict[str, Any]

_HEADER = msgspec.msgpack.Decoder(FrameHeader)
_REPLY = msgspec.msgpack.Decoder(InferReply)
_NEWEST_VIEWS = 64  # of one source: among so many a picture is looked for
_ASIDES_S = 60.0  # between two looks at what was set aside
_ROW_BYTES = 1024  # of a view in the log, beside its picture: about


class Journal:
    """One file; used by the loop alone, but for ``history``, ``picture`` and ``after``.

    Attributes:
        number: of the newest view taken, in the log.
        problem: why views can't be logged now; empty while they can.
    """

    def __init__(self, node: Node, settings: FusionSettings, keep_s: float | None = None) -> None:
        """``keep_s``: how long pictures may stay in the file; None: as long as the log needs them."""
        self._node, self._settings, self._keep_s = node, settings, keep_s
        self._store = Store(Path(settings.store), max_events=settings.max_events, overwrite=keep_s is not None)
        self._age, self._asides_s = LogAge(keep_s), -math.inf
        self._wipes = False  # once the log is empty of what shall be forgotten
        self.number = 0
        self.problem = ""
        self._events: list[StoredEvent] = []  # not written yet
        self._since_snapshot = (0, 0)  # views taken and bytes logged
        self._again_s = 0.0
        self._saving: threading.Thread | None = None

    @property
    def rests(self) -> bool:
        """Whether it waits a while after the file couldn't be written."""
        return time.monotonic() < self._again_s

    # --- views and events -----------------------------------------------------------------------------------------

    def append(self, views: Sequence[PerceivedView]) -> list[int]:
        """Commits views; returns their numbers. StoreError: none was written."""
        numbers = self._store.append([_entry(p) for p in views])
        self.problem = ""
        return numbers

    def block(self, error: StoreError) -> None:
        """Says that views wait, and rests."""
        self.problem = f"views wait, the store can't be written: {error}"
        self._again_s = time.monotonic() + self._settings.retry_s
        self._node.warn_seldom("the store can't be written", error=str(error))

    def note(
        self, number: int, perceived: PerceivedView, floor: str, changes: Sequence[ObjectChange], *, taken: bool
    ) -> None:
        """Notes a logged view that the maps took or refused, and what it changed. A refused one buys no snapshot, but its
        bytes do: the log is bounded."""
        self.number = number
        self._age.logged(time.monotonic())
        views, n_bytes = self._since_snapshot
        self._since_snapshot = views + taken, n_bytes + len(perceived.payload) + _ROW_BYTES
        self._events += [
            StoredEvent(number, k, floor, change.object_id, change.absorbed, change.event)
            for k, change in enumerate(changes)
        ]

    def write_events(self) -> None:
        """Commits the events noted. If that fails they wait; the views that made them are logged."""
        if not self._events:
            return
        try:
            self._store.add_events(self._events)
            self._events = []
        except StoreError as error:
            self._node.warn_seldom("events can't be written", error=str(error))

    def history(self, floor: str, object_id: int) -> list[ObjectEvent]:
        """Everything that ever happened to an object. StoreError: it can't be read."""
        return self._store.history(floor, object_id)

    def picture(self, source: str, view: int, seq: int) -> bytes | None:
        """The JPEG of a view that is logged still; None if it isn't. StoreError: the log can't be read."""
        for entry in self._store.newest(source, view, _NEWEST_VIEWS):
            header = _HEADER.decode(entry.header)
            if header.seq == seq and entry.payload and header.image.encoding == "jpeg":
                return bytes(entry.payload[: header.image.n_bytes])
        return None

    def after(self, number: int) -> tuple[int, Entry] | None:
        """The first view in the log after one, with its number, if the maps have taken it. From any thread. StoreError: it can't
        be read."""
        newest = self.number
        for k, entry in self._store.log(number):
            if k > newest:
                return None
            if entry is not None:  # who asks sees by the numbers that one is missing
                return k, entry
        return None

    # --- snapshots ------------------------------------------------------------------------------------------------

    @property
    def snapshot_is_due(self) -> bool:
        """Whether enough was logged since the last one, or too long ago, and none is being written."""
        views, n_bytes = self._since_snapshot
        enough = views >= self._settings.snapshot_views or n_bytes >= self._settings.snapshot_mb << 20
        enough = enough or self._age.is_due(time.monotonic())
        busy = self._saving is not None and self._saving.is_alive()
        return enough and not busy and not self._events

    def save(self, state: State) -> None:
        """Saves a snapshot of the maps beside the loop; ``state`` must not change any more."""
        self._since_snapshot = 0, 0
        wipes = self._age.saved(time.monotonic()) and self._wipes
        self._wipes = self._wipes and not wipes
        self._saving = threading.Thread(
            target=self._save, args=(state, self.number, wipes), name="snapshot", daemon=True
        )
        self._saving.start()

    def save_first(self, state: State) -> None:
        """Saves a snapshot in a file that was begun anew, before any view goes into it. StoreError: it wasn't written."""
        self._since_snapshot = 0, 0
        self._store.save(pack(state), 0)

    def _save(self, state: State, up_to: int, wipes: bool) -> None:
        try:
            self._store.save(pack(state), up_to)
            if wipes:
                self._store.wipe()
                self._node.log.info("pictures_forgotten", up_to=up_to)
        except Exception as error:  # the log goes on from the one before
            self._age.failed(time.monotonic())
            self._wipes = self._wipes or wipes
            self._node.warn_seldom("a snapshot can't be written", error=f"{type(error).__name__}: {error}")

    # --- pictures -------------------------------------------------------------------------------------------------

    def forget_pictures(self) -> None:
        """Has all pictures leave the file, by the two next snapshots, and what was set aside. From any thread."""
        self._age.forget()
        self._wipes = True
        self._asides_s = -math.inf

    def drop_old(self) -> None:
        """Removes what was set aside longer ago than pictures may be kept. Called often; looks seldom."""
        now_s = time.monotonic()
        if (self._keep_s is None and not self._wipes) or now_s - self._asides_s < _ASIDES_S:
            return
        self._asides_s = now_s
        try:
            removed = self._store.drop_aside(math.inf if self._wipes else time.time() - (self._keep_s or 0.0))
            if removed:
                self._node.log.info("set_aside_removed", files=removed)
        except StoreError as error:
            self._node.warn_seldom("what was set aside can't be removed", error=str(error))

    def close(self) -> None:
        """Ends a snapshot that is being written, and closes the file."""
        self._end_saving()
        self._store.close()

    def _end_saving(self) -> None:
        if self._saving is not None:
            self._saving.join()

    # --- reading it again -----------------------------------------------------------------------------------------

    def load(self, restore: Callable[[State], None]) -> None:
        """Gives ``restore`` the newest snapshot that can be read; damaged ones are said.

        Raises:
            SnapshotError: it is of another version or other settings. StoreError.
        """
        damaged = []
        for up_to, data in self._store.snapshots():
            try:
                if data is None:
                    raise SnapshotError("corrupt", "its bytes aren't those that were written")
                restore(unpack(data))
                self.number = up_to
                return
            except SnapshotError as error:
                if error.name != "corrupt":
                    raise
                self._node.log.warning("snapshot_corrupt", up_to=up_to, error=str(error))
                damaged.append(up_to)
        first = next((number for number, _ in self._store.log(0)), 0 if damaged else 1)
        if first != 1 or 0 in damaged:  # the next snapshots take the place of what somebody may still repair
            aside = self._store.set_aside("snapshots_lost", copy=True)
            self._node.log.warning("snapshots_lost", log_begins_at=first, copied_to=str(aside))

    def replay(self, take: Callable[[int, PerceivedView], None]) -> None:
        """Gives ``take`` the views logged since, with their numbers; damaged and missing ones are said. StoreError."""
        after = self.number
        for number, entry in self._store.log(after):
            if number > after + 1:
                self._node.log.warning("log_gap", after=after, next=number)
            after = number
            try:
                if entry is None:
                    raise WireError("its bytes aren't those that were written")
                take(number, perceived_of(entry))
            except Exception as error:  # a view that ended the last process must not end this one, too
                self._node.log.warning("log_view_lost", number=number, error=f"{type(error).__name__}: {error}")
        self.write_events()
        if self._keep_s is not None and self.number:  # nobody knows since when they lie there
            self.forget_pictures()

    def begin_anew(self, reason: str) -> Path:
        """Sets a file aside that is of no use any more; returns where to. StoreError: it can't be moved."""
        self._end_saving()  # into the old file
        aside = self._store.set_aside(reason)
        self.number = 0
        return aside


def _entry(p: PerceivedView) -> Entry:
    source, view = p.key
    return Entry(source, view, msgspec.msgpack.encode(p.header), bytes(p.payload), p.reply, p.digest, p.fault)


def perceived_of(entry: Entry) -> PerceivedView:
    """What was logged. WireError, msgspec.DecodeError: it can't be read."""
    key, header = (entry.source, entry.view), _HEADER.decode(entry.header)
    if entry.fault or not entry.payload:
        return PerceivedView(key, header, fault=entry.fault)
    view = decode_frame(header, entry.payload)
    perception = perception_from_wire(_REPLY.decode(entry.reply), header.camera) if entry.reply else None
    return PerceivedView(key, header, view, perception, entry.payload, entry.reply, entry.digest)
