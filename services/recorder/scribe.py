"""Writes recordings on a thread of its own: however slow or full the disk is, nobody on the bus waits for it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

from surveilnav.bus import Node, clock_ns
from surveilnav.bus.wire import encode
from surveilnav.services.recorder.config import RecorderSettings
from surveilnav.services.recorder.core.drawer import Drawer, Heard
from surveilnav.services.recorder.core.limits import Limits
from surveilnav.services.recorder.file import RecordingFile
from surveilnav.services.recorder.folder import Folder
from surveilnav.services.recorder.reading import BEGIN, END

_TIDY_S = 30.0
_PATIENCE_S = 10.0  # for what waits when the recorder ends


@dataclass(slots=True)
class _Open:
    """A file that is written, and what its drawings need to know."""

    file: RecordingFile
    drawer: Drawer = field(default_factory=Drawer)


class Scribe:
    """``begin``, ``attach``, ``hear`` and ``end`` come back at once, from any thread.

    Attributes:
        failed: why a recording ended before its mission, by id.
        dropped: messages that there was no room for.
        full: why nothing can be recorded; empty while the disk takes what comes.
        n_bytes, free_bytes: of all files, and left on their disk.
    """

    def __init__(
        self, node: Node, settings: RecorderSettings, folder: Folder, keep_pictures_s: float | None = None
    ) -> None:
        """``keep_pictures_s``: recordings hold pictures, and may be no older; None: no such limit."""
        self._node, self._settings, self._folder = node, settings, folder
        ages_s = [s for s in (settings.max_days * 86_400, keep_pictures_s) if s]
        self._limits = Limits(settings.max_mb << 20, int(min(ages_s, default=0) * 1e9))
        self._room = threading.Condition()
        self._waiting: deque[tuple[int, Callable[[], None]]] = deque()
        self._waiting_bytes, self._ended = 0, False
        self._attaching = 0
        self._files: dict[str, _Open] = {}
        self.failed: dict[str, str] = {}
        self.dropped, self.full, self.n_bytes, self.free_bytes = 0, "", 0, 0
        self._thread = threading.Thread(target=self._run, name="scribe", daemon=True)
        self._thread.start()

    @property
    def has_room(self) -> bool:
        """Whether more may be brought that could as well wait elsewhere."""
        return self._waiting_bytes < self._settings.queue_mb << 19  # half of it

    @property
    def open(self) -> list[str]:
        """The ids of the files that are written now."""
        return sorted(self._files)

    def begin(self, id: str, facts: Mapping[str, str]) -> None:
        """Opens a file."""
        self._put(0, lambda: self._begin(id, facts))

    @property
    def is_attaching(self) -> bool:
        """Whether maps wait to be written: they are large, and the queue doesn't count them."""
        return self._attaching > 0

    def attach(self, ids: Collection[str], name: str, data: bytes, facts: Mapping[str, str]) -> None:
        """Adds maps to files, and facts about them."""

        def write(opened: _Open) -> None:
            opened.file.note(name, facts)
            opened.file.attach(name, "application/zstd", data, clock_ns())

        def attach() -> None:
            try:
                for id in ids:
                    self._in_file(id, write)
            finally:
                with self._room:
                    self._attaching -= 1

        with self._room:
            self._attaching += 1
        self._put(0, attach)

    def hear(self, ids: Collection[str], heard: Heard) -> bool:
        """Adds a message to files; False: there is no room, and it is counted."""
        n_bytes = len(heard.payload) + len(encode(heard.message))
        if self._waiting_bytes + n_bytes > self._settings.queue_mb << 20:
            self.dropped += 1
            self._node.warn_seldom("the disk is too slow", dropped=self.dropped)
            return False
        self._put(n_bytes, lambda: self._hear(ids, heard))
        return True

    def end(self, id: str, facts: Mapping[str, str]) -> None:
        """Closes a file with its last facts; none: its mission goes on without it."""
        self._put(0, lambda: self._end_or_forget(id, facts))

    def close(self) -> None:
        """Writes what waits and closes all files."""
        with self._room:
            self._ended = True
            self._room.notify_all()
        self._thread.join(timeout=_PATIENCE_S)

    # --- the thread -----------------------------------------------------------------------------------------------

    def _put(self, n_bytes: int, work: Callable[[], None]) -> None:
        with self._room:
            self._waiting.append((n_bytes, work))
            self._waiting_bytes += n_bytes
            self._room.notify_all()

    def _run(self) -> None:
        self._guarded(self._tidy)
        flush_at_s, tidy_at_s = 0.0, time.monotonic() + _TIDY_S
        while True:
            with self._room:
                if not self._waiting and not self._ended:
                    self._room.wait(timeout=self._settings.flush_s / 2)
                n_bytes, work = self._waiting.popleft() if self._waiting else (0, None)
            if work is not None:
                self._guarded(work)
                with self._room:
                    self._waiting_bytes -= n_bytes
            now_s = time.monotonic()
            if now_s >= flush_at_s:
                flush_at_s = now_s + self._settings.flush_s
                self._flush()
            if now_s >= tidy_at_s:
                tidy_at_s = now_s + _TIDY_S
                self._guarded(self._tidy)
            if self._ended and not self._waiting:
                break
        for id, opened in list(self._files.items()):
            self._guarded(partial(self._end, id, opened, {}))

    def _guarded(self, work: Callable[[], None]) -> None:
        """Does what may fail without ending the thread."""
        try:
            work()
        except OSError as error:
            self._node.warn_seldom("recordings can't be kept", error=str(error))
        except Exception as error:  # a bug must cost one message, not all that come
            self._node.warn_seldom("a message can't be recorded", error=f"{type(error).__name__}: {error}")

    def _begin(self, id: str, facts: Mapping[str, str]) -> None:
        try:
            self._tidy()
            self._check_room()
            opened = self._files[id] = _Open(RecordingFile(self._folder.file_of(id)))
            opened.file.note(BEGIN, facts)
            self.full = ""
            self._node.log.info("recording", id=id)
        except OSError as error:
            self._fail(id, error)

    def _in_file(self, id: str, work: Callable[[_Open], object]) -> None:
        """Does something with a file that is still written; ends it where the disk refuses."""
        opened = self._files.get(id)
        if opened is None:
            return
        try:
            work(opened)
        except OSError as error:
            self._fail(id, error)

    def _hear(self, ids: Collection[str], heard: Heard) -> None:
        def write(opened: _Open) -> None:
            for line in opened.drawer.lines(heard):
                opened.file.write(line)

        for id in ids:
            self._in_file(id, write)

    def _end(self, id: str, opened: _Open, facts: Mapping[str, str]) -> None:
        if facts:
            opened.file.note(END, facts)
        opened.file.finish()
        del self._files[id]
        self._node.log.info("recorded", id=id, mb=round(opened.file.n_bytes / 2**20, 1), complete=bool(facts))
        self._tidy()

    def _end_or_forget(self, id: str, facts: Mapping[str, str]) -> None:
        """Ends a file; one that failed is history, if there is room again."""
        self._in_file(id, lambda opened: self._end(id, opened, facts))
        if self.failed.pop(id, None) is not None and not self.failed:
            self._check_room()
            self.full = ""

    def _flush(self) -> None:
        for id in list(self._files):
            self._in_file(id, self._flush_one)
        self._guarded(self._measure)

    def _measure(self) -> None:
        self.n_bytes, self.free_bytes = sum(f.n_bytes for f in self._folder.kept()), self._folder.free_bytes()

    def _flush_one(self, opened: _Open) -> None:
        opened.file.flush()
        self._check_room()

    def _check_room(self) -> None:
        """OSError: others need what is left of the disk."""
        least = self._settings.min_free_mb << 20
        if (free := self._folder.free_bytes()) < least:
            raise OSError(f"{free >> 20} MB are left on the disk of {self._folder.path}, less than min_free_mb")

    def _tidy(self) -> None:
        for gone in self._folder.tidy(self._limits, clock_ns()):
            self._node.log.info("deleted an old recording", id=gone)

    def _fail(self, id: str, error: OSError) -> None:
        """The mission goes on, its recording ends here."""
        opened = self._files.pop(id, None)
        if opened is not None:
            with suppress(OSError):
                opened.file.abandon()
        self.full = f"recording stopped: {error}. Make room, or set SURVEILNAV_RECORDER__FOLDER to another disk"
        self.failed[id] = str(error)
        self._node.log.error("recording stopped", id=id, error=str(error))
