"""The log of views: each view is logged before it is integrated, so that a restart can compute the same maps again.

After a restart, the newest readable snapshot is loaded and the views logged after it are integrated in their order. The
result equals the maps of before bit by bit, so every revision that was announced can be restored. While the disk can't be
written, views wait, nothing is announced, and ``problem`` says why. Without a file (no ``store`` in the settings), views are
integrated as they come.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from enum import Enum
from pathlib import Path

from surveilnav.bus import Node, bound_request_id
from surveilnav.messages.maps import ObjectEvent
from surveilnav.services.fusion.building_maps import BuildingMaps, Outcome
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.snapshot import SnapshotError
from surveilnav.services.fusion.map_log.rebuild import stored_events
from surveilnav.services.fusion.map_log.recovery import entry_from_perceived, jpeg_of, replay, restore_snapshot
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.map_log.removals import Removals
from surveilnav.services.fusion.map_log.snapshots import SnapshotWriter
from surveilnav.services.fusion.map_log.store import Entry, Store, StoredEvent, StoreError
from surveilnav.services.fusion.perceived import PerceivedView, ViewKey

_NEWEST_VIEWS = 64  # of one view, among which a picture is looked for


class LogState(Enum):
    """Whether the file holds what the maps hold."""

    NO_FILE = "the maps end with the process"
    UNREAD = "the maps haven't been restored from the file yet"
    LACKS_MAPS = "the file is new and needs a snapshot of the maps before any view is logged"
    READY = "the file holds everything that the maps hold"


class MapLog:
    """Logs views and integrates them. For the main loop; ``forget_pictures`` and what only reads are thread-safe.

    Attributes:
        state: whether the file holds what the maps hold.
        problem: why views can't be logged now; "" while they can.
        removals: takes what a source has contributed out of the maps again.
    """

    def __init__(
        self, node: Node, settings: FusionSettings, maps: BuildingMaps, keep_pictures_s: float | None = None
    ) -> None:
        """``keep_pictures_s``: how long pictures may stay in the file; None: as long as the log needs them."""
        self._node, self._maps = node, maps
        self._retry_s, self._retry_at_s = settings.retry_s, 0.0
        self._pictures_expire = keep_pictures_s is not None
        self._waiting: dict[ViewKey, PerceivedView] = {}
        self._events: list[StoredEvent] = []  # that aren't written yet
        self.problem = ""
        self.state = LogState.UNREAD if settings.store else LogState.NO_FILE
        self._store = Store(Path(settings.store), max_events=settings.max_events, overwrite=self._pictures_expire)
        self._snapshots = SnapshotWriter(node, self._store, settings, keep_pictures_s)
        self.removals = Removals(node, self._store if settings.store else None, maps)
        self._make_ready()

    @property
    def is_blocked(self) -> bool:
        """Whether views wait because the file can't be written. Then no more should be taken from perception."""
        return bool(self._waiting and self.problem)

    # --- views ----------------------------------------------------------------------------------------------------

    def integrate(self, arrived: Iterable[PerceivedView]) -> None:
        """Logs and integrates views, ordered by time stamp, source and view index. Writes a snapshot if one is due."""
        for perceived in arrived:
            if self._is_new(perceived):
                self._waiting[perceived.key] = perceived
        if self._waiting and time.monotonic() >= self._retry_at_s and self._make_ready():
            self._log_and_integrate()
        ready = self.state is LogState.NO_FILE or (self.state is LogState.READY and not self.problem)
        if way := self.removals.step(ready=ready):
            self._events = [] if way == "replay" else self._events
            self._snapshots.make_due()  # so that the maps needn't be computed again after a restart
        if self.state is LogState.READY:
            if self._snapshots.is_due and not self._events and not self.removals.is_running:
                self._snapshots.write(self._maps.freeze())
            self._snapshots.remove_old_files()

    def withdraw(self, removal: Removal) -> None:
        """Drops views of a camera that wait for the file and that a removal takes away."""
        for key in [k for k, p in self._waiting.items() if removal.includes(k[0], p.header.stamp_ns)]:
            del self._waiting[key]

    def _is_new(self, perceived: PerceivedView) -> bool:
        """Whether a view must be logged. False if its picture, or its fault, is the one that was processed last."""
        key, processed = perceived.key, self._maps.processed
        if processed.repeats_fault(perceived):
            self._report(perceived, Outcome(fault=perceived.fault))
            return False
        return bool(perceived.fault) or (perceived.view is not None and not processed.contains(key, perceived.digest))

    def _log_and_integrate(self) -> None:
        batch = sorted(self._waiting.values(), key=lambda p: (p.header.stamp_ns, p.key))
        numbers = [0] * len(batch)
        if self.state is LogState.READY:
            try:
                numbers = self._store.append([entry_from_perceived(p) for p in batch])
                self.problem = ""
            except StoreError as error:
                self._block(error)
                if error.name == "corrupt":
                    self._begin_new_file(error.name, str(error))
                return
        self._waiting.clear()
        for number, perceived in zip(numbers, batch, strict=True):
            with bound_request_id(perceived.request_id):
                self._report(perceived, self._integrate(number, perceived))
        self._write_events()

    def _integrate(self, number: int, perceived: PerceivedView) -> Outcome:
        """Integrates a logged view, and collects the events that it causes."""
        outcome = self._maps.integrate(perceived, number)
        if self.state is not LogState.NO_FILE:
            self._snapshots.record_logged(len(perceived.payload), integrated=outcome.integrated)
            self._events += stored_events(number, outcome)
        return outcome

    def _report(self, perceived: PerceivedView, outcome: Outcome) -> None:
        """Counts and logs what is wrong with a view, by the name of the fault."""
        source, view = perceived.key
        if outcome.n_missed:
            self._node.reject("view.missing_seq", f"{source} skipped {outcome.n_missed} before {perceived.header.seq}")
        if outcome.fault:
            name = outcome.fault.partition(":")[0]
            self._node.reject(f"view.{name}", f"{source} view {view}: {outcome.fault}")

    def _write_events(self) -> None:
        """Commits the events of objects. If that fails, it is tried again later; the views that caused them are logged."""
        if not self._events:
            return
        try:
            self._store.add_events(self._events)
            self._events = []
        except StoreError as error:
            self._node.warn_seldom("events can't be written", error=str(error))

    def _block(self, error: StoreError) -> None:
        """Makes views wait for the file, which is tried again after a pause."""
        self.problem = f"views wait, the store can't be written: {error}"
        self._retry_at_s = time.monotonic() + self._retry_s
        self._node.warn_seldom("the store can't be written", error=str(error))

    # --- queries --------------------------------------------------------------------------------------------------

    def object_history(self, floor: str, object_id: int) -> list[ObjectEvent] | None:
        """All events of an object since its creation; None without a file. StoreError: the file can't be read."""
        return None if self.state is LogState.NO_FILE else self._store.history(floor, object_id)

    def picture(self, source: str, view: int, seq: int) -> bytes | None:
        """The JPEG of a view; None if the log doesn't have it (any more). StoreError: the file can't be read."""
        if self.state is LogState.NO_FILE:
            return None
        newest = self._store.newest(source, view, _NEWEST_VIEWS)
        return next((jpeg for entry in newest if (jpeg := jpeg_of(entry, seq)) is not None), None)

    def next_view(self, after: int) -> tuple[int, int, Entry | None]:
        """The first integrated view in the log after number ``after``.

        Returns:
            The number of the newest integrated view, the number of the view found (0: there is none yet), and the view.

        Raises:
            StoreError: the log can't be read, or there is none.
        """
        if self.state is LogState.NO_FILE:
            raise StoreError("no_log", "fusion keeps no log of views: set SURVEILNAV_FUSION__STORE")
        newest = self._maps.number
        for number, entry in self._store.log(after):
            if number > newest:
                break
            if entry is not None:  # a damaged view is skipped, which the client sees by the numbers
                return newest, number, entry
        return newest, 0, None

    def forget_pictures(self) -> bool:
        """Has all pictures removed from the file within seconds. False: there is no file."""
        if self.state is LogState.NO_FILE:
            return False
        self._snapshots.forget_pictures()
        return True

    def close(self) -> None:
        """Finishes a snapshot that is being written, stops a removal, which goes on after the next start, and closes the file."""
        self.removals.close()
        self._snapshots.wait()
        self._store.close()

    # --- recovery -------------------------------------------------------------------------------------------------

    def _make_ready(self) -> bool:
        """Brings file and maps into the same state, if possible; returns whether views may be logged now."""
        if self.state is LogState.UNREAD:
            self._recover()
        if self.state is LogState.LACKS_MAPS:
            try:
                self._snapshots.write_first(self._maps.freeze())
                self.state = LogState.READY
            except StoreError as error:
                self._block(error)
        return self.state in (LogState.READY, LogState.NO_FILE)

    def _recover(self) -> None:
        """Restores the maps from the file. A file that can't be used is set aside; one that can't be read now is tried again.

        A file that is damaged elsewhere is set aside with the maps restored: views that are written into it might be lost.
        """
        began_s = time.monotonic()
        try:
            self._replay(restore_snapshot(self._store, self._node, self._maps, self.removals.load()))
            if damage := self._store.damage():
                raise StoreError("corrupt", damage)
            self.state = LogState.READY
        except (SnapshotError, StoreError) as error:
            if isinstance(error, StoreError) and error.name == "unwritable":
                self._block(error)
                return
            self._begin_new_file(error.name, str(error))
        revision = self._maps.joint.revision
        if revision and self.state is not LogState.UNREAD:
            self._node.log.info("restored", revision=revision, seconds=round(time.monotonic() - began_s, 2))

    def _replay(self, removals: list[Removal]) -> None:
        """Integrates the views logged after the snapshot, without those that were removed. Raises StoreError."""
        begin, n_removals = self._maps.number, self._maps.removals
        for _ in replay(self._store, self._node, self._maps, removals, self._integrate):
            pass
        is_from_log_alone = begin == 0 and any(True for _ in self._store.snapshots())
        if is_from_log_alone or self._maps.removals > n_removals:
            self._store.replace_events(begin, self._events)  # ids of objects may be others than those in the file
            self._events = []
            self._snapshots.make_due()
        if self._maps.removals > n_removals:
            self.removals.finish_after_restart()
        self._write_events()
        if self._pictures_expire and self._maps.number:  # it is unknown how long its pictures have been in the file
            self._snapshots.forget_pictures()

    def _begin_new_file(self, name: str, message: str) -> None:
        """Sets aside a file that can't be used any more. If the maps hold anything, they are written into the new one first."""
        self._snapshots.wait()  # a snapshot may still be written into the old file
        try:
            aside = self._store.set_aside(name)
        except StoreError as error:
            self._block(error)
            return
        self._maps.number = self._maps.removals = 0
        joint, processed = self._maps.joint, self._maps.processed
        self._node.log.warning(f"store_{name}", error=message, moved_to=str(aside), revision=joint.revision)
        has_content = joint.revision or processed.robots or processed.views
        self.state = LogState.LACKS_MAPS if has_content else LogState.READY
