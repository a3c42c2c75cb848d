"""When snapshots of the maps are due, and a thread that writes them beside the main loop.

Privacy sets a limit on how long pictures may stay in the log. If it does, the store drops the part of the log that the older of
its two snapshots contains, so a picture leaves the file with the second snapshot after it. Without a limit the log reaches back
farther (``retention``).
"""

from __future__ import annotations

import math
import threading
import time

from surveilnav.bus import Node
from surveilnav.services.fusion.building_maps import State
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.snapshot import pack
from surveilnav.services.fusion.map_log.removal import SnapshotContents
from surveilnav.services.fusion.map_log.retention import NO_RETENTION, Retention
from surveilnav.services.fusion.map_log.store import Store, StoreError

_RETRY_S = 30.0  # after a snapshot that was due for privacy couldn't be written
_CLEAN_UP_S = 60.0  # between two checks of the files that were set aside
_ROW_BYTES = 1024  # that a view takes in the log, roughly, apart from its picture


class SnapshotWriter:
    """Says when a snapshot is due, and writes it on a thread of its own.

    To be used by the main loop; only ``forget_pictures`` is thread-safe.
    """

    def __init__(self, node: Node, store: Store, settings: FusionSettings, keep_pictures_s: float | None) -> None:
        """``keep_pictures_s``: how long pictures may stay in the file; None: as long as the log needs them."""
        self._node, self._store, self._settings = node, store, settings
        self._views, self._bytes = 0, 0  # integrated and logged since the last snapshot
        self._age = PictureAge(keep_pictures_s)
        self._keep_pictures_s = keep_pictures_s
        self._wipe = (
            False  # after the second snapshot, overwrite the file's free pages: they still hold deleted pictures
        )
        self._cleaned_up_s = -math.inf
        self._is_wanted = False  # one is due whatever was logged
        self._retention = Retention(settings.log_views, settings.log_mb << 20)
        self._thread: threading.Thread | None = None

    def record_logged(self, n_bytes: int, *, integrated: bool) -> None:
        """Counts a logged view towards the next snapshot.

        Its bytes always count, because the log must stay bounded. Its number counts only if it was integrated, because then a
        restart has to integrate it again.
        """
        self._views += integrated
        self._bytes += n_bytes + _ROW_BYTES
        self._age.record_logged(time.monotonic())

    @property
    def is_due(self) -> bool:
        """Whether a snapshot should be written now. False while one is being written."""
        settings = self._settings
        due = self._views >= settings.snapshot_views or self._bytes >= settings.snapshot_mb << 20
        due = due or self._is_wanted or self._age.is_due(time.monotonic())
        return due and not (self._thread is not None and self._thread.is_alive())

    def write(self, state: State) -> None:
        """Starts to write a snapshot beside the main loop. ``state`` mustn't change any more."""
        self._views, self._bytes, self._is_wanted = 0, 0, False
        pictures_go = self._keep_pictures_s is not None or self._age.is_forgetting
        wipe = self._age.record_snapshot(time.monotonic()) and self._wipe
        self._wipe = self._wipe and not wipe
        retention = NO_RETENTION if pictures_go else self._retention
        self._thread = threading.Thread(target=self._write, args=(state, wipe, retention), name="snapshot", daemon=True)
        self._thread.start()

    def write_first(self, state: State) -> None:
        """Writes the first snapshot of a new file before it returns. StoreError: it wasn't written."""
        self._views, self._bytes = 0, 0
        self._store.save(pack(state | {"number": 0}), 0, _contents(state))

    def make_due(self) -> None:
        """Makes a snapshot due at once."""
        self._is_wanted = True

    def forget_pictures(self) -> None:
        """Has all pictures removed from the file: two snapshots become due at once. Safe from any thread."""
        self._age.forget()
        self._wipe = True
        self._cleaned_up_s = -math.inf

    def remove_old_files(self) -> None:
        """Removes files that were set aside longer ago than pictures may be kept. May be called often; it acts once a minute."""
        now_s = time.monotonic()
        if (self._keep_pictures_s is None and not self._wipe) or now_s - self._cleaned_up_s < _CLEAN_UP_S:
            return
        self._cleaned_up_s = now_s
        try:
            before_s = math.inf if self._wipe else time.time() - (self._keep_pictures_s or 0.0)
            if removed := self._store.drop_aside(before_s):
                self._node.log.info("set_aside_removed", files=removed)
        except StoreError as error:
            self._node.warn_seldom("what was set aside can't be removed", error=str(error))

    def wait(self) -> None:
        if self._thread is not None:
            self._thread.join()

    def _write(self, state: State, wipe: bool, retention: Retention = NO_RETENTION) -> None:
        try:
            self._store.save(pack(state), state["number"], _contents(state), retention)
            if wipe:
                self._store.wipe()
                self._node.log.info("pictures_forgotten", up_to=state["number"])
        except Exception as error:  # nothing is lost, since the log goes back to the previous snapshot
            self._age.record_failure(time.monotonic())
            self._wipe = self._wipe or wipe
            self._node.warn_seldom("a snapshot can't be written", error=f"{type(error).__name__}: {error}")


def _contents(state: State) -> SnapshotContents:
    spans = {source: (first_ns, last_ns) for source, (first_ns, last_ns) in state["processed"]["spans"].items()}
    return SnapshotContents(state["removals"], spans)


class PictureAge:
    """Says when snapshots are due, so that no picture stays in the log for longer than ``keep_s`` (None: without a limit).

    Times are those of a monotonic clock [s].
    """

    def __init__(self, keep_s: float | None) -> None:
        self._keep_s = keep_s
        self._oldest_new_s: float | None = None  # when the oldest view was logged that no snapshot contains
        self._oldest_superseded_s: float | None = None  # ... that only one snapshot contains; the next one drops it
        self._snapshots_wanted, self._retry_at_s = 0, 0.0

    @property
    def is_forgetting(self) -> bool:
        """Whether snapshots are still to be written so that everything that was logged before is gone."""
        return self._snapshots_wanted > 0

    def forget(self) -> None:
        """Makes two snapshots due, after which everything that is in the log now is gone."""
        self._snapshots_wanted, self._retry_at_s = 2, 0.0

    def record_logged(self, now_s: float) -> None:
        self._oldest_new_s = now_s if self._oldest_new_s is None else self._oldest_new_s

    def record_snapshot(self, now_s: float) -> bool:
        """Records that a snapshot is being written; returns whether it removes everything that was to be forgotten."""
        self._oldest_superseded_s = now_s if self._oldest_new_s is not None else None
        self._oldest_new_s = None
        self._snapshots_wanted -= self._snapshots_wanted > 0
        return self._snapshots_wanted == 0

    def record_failure(self, now_s: float) -> None:
        """Records that a snapshot couldn't be written, so that the log is as it was."""
        if self._keep_s is not None or self._snapshots_wanted:
            self._snapshots_wanted, self._retry_at_s = 2, now_s + _RETRY_S

    def is_due(self, now_s: float) -> bool:
        """Whether a snapshot must be written so that pictures are removed in time."""
        if now_s < self._retry_at_s:
            return False
        if self._snapshots_wanted:
            return True
        marks = [mark for mark in (self._oldest_new_s, self._oldest_superseded_s) if mark is not None]
        return self._keep_s is not None and any(now_s - mark >= self._keep_s / 2 for mark in marks)
