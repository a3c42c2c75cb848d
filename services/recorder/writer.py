"""Writes recordings on a thread of its own, so that nobody on the bus waits for a slow or full disk."""

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
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.foxglove import FoxgloveConverter
from surveilnav.services.recorder.core.limits import Limits
from surveilnav.services.recorder.file import RecordingFile
from surveilnav.services.recorder.folder import RecordingFolder
from surveilnav.services.recorder.reading import BEGIN, END

_ENFORCE_LIMITS_S = 30.0
_CLOSE_TIMEOUT_S = 10.0  # for what still waits when the recorder ends


@dataclass(slots=True)
class _OpenRecording:
    """A file that is being written, and the converter that remembers its floors and cameras."""

    file: RecordingFile
    converter: FoxgloveConverter = field(default_factory=FoxgloveConverter)


class RecordingWriter:
    """Writes recordings. ``begin``, ``attach``, ``record`` and ``end`` return at once, from any thread.

    Attributes:
        failed: why a recording ended before its mission, by the recording's id.
        dropped: how many messages were dropped because the queue was full.
        problem: why nothing can be recorded; empty while the disk can be written.
        n_bytes, free_bytes: size of all files, and free space on their disk.
    """

    def __init__(
        self,
        node: Node,
        settings: RecorderSettings,
        folder: RecordingFolder,
        keep_pictures_s: float | None = None,
    ) -> None:
        """``keep_pictures_s``: recordings hold pictures, so they are deleted at this age, too; None: no such limit."""
        self._node, self._settings, self._folder = node, settings, folder
        ages_s = [s for s in (settings.max_days * 86_400, keep_pictures_s) if s]
        self._limits = Limits(settings.max_mb << 20, int(min(ages_s, default=0) * 1e9))
        self._queue_changed = threading.Condition()
        self._queue: deque[tuple[int, Callable[[], None]]] = deque()  # (bytes, what to do)
        self._queue_bytes, self._closing = 0, False
        self._attaching = 0
        self._files: dict[str, _OpenRecording] = {}
        self.failed: dict[str, str] = {}
        self.dropped, self.problem, self.n_bytes, self.free_bytes = 0, "", 0, 0
        self._thread = threading.Thread(target=self._run, name="recording-writer", daemon=True)
        self._thread.start()

    @property
    def has_room(self) -> bool:
        """Whether the queue is less than half full. What can wait elsewhere should wait otherwise."""
        return self._queue_bytes < self._settings.queue_mb << 19

    @property
    def open(self) -> list[str]:
        """The ids of the recordings that are being written."""
        return sorted(self._files)

    @property
    def is_attaching(self) -> bool:
        """Whether maps wait to be written. They are large, and the queue doesn't count them."""
        return self._attaching > 0

    def begin(self, id: str, facts: Mapping[str, str]) -> None:
        """Begins a recording with facts about its mission."""
        self._put(0, lambda: self._begin(id, facts))

    def attach(self, ids: Collection[str], name: str, data: bytes, facts: Mapping[str, str]) -> None:
        """Adds maps to recordings, and facts about them."""

        def write(opened: _OpenRecording) -> None:
            opened.file.add_metadata(name, facts)
            opened.file.add_attachment(name, "application/zstd", data, clock_ns())

        def attach() -> None:
            try:
                for id in ids:
                    self._with_file(id, write)
            finally:
                with self._queue_changed:
                    self._attaching -= 1

        with self._queue_changed:
            self._attaching += 1
        self._put(0, attach)

    def record(self, ids: Collection[str], message: BusMessage) -> bool:
        """Adds a message to recordings. Returns False if the queue is full; the message is then dropped and counted."""
        n_bytes = len(message.payload) + len(encode(message.message))
        if self._queue_bytes + n_bytes > self._settings.queue_mb << 20:
            self.dropped += 1
            self._node.warn_seldom("the disk is too slow", dropped=self.dropped)
            return False
        self._put(n_bytes, lambda: self._record(ids, message))
        return True

    def end(self, id: str, facts: Mapping[str, str]) -> None:
        """Ends a recording with facts about how its mission ended."""
        self._put(0, lambda: self._end_or_forget(id, facts))

    def close(self) -> None:
        """Writes what waits and closes all files. Recordings whose missions go on are marked as interrupted."""
        with self._queue_changed:
            self._closing = True
            self._queue_changed.notify_all()
        self._thread.join(timeout=_CLOSE_TIMEOUT_S)

    # --- the thread -----------------------------------------------------------------------------------------------

    def _put(self, n_bytes: int, work: Callable[[], None]) -> None:
        with self._queue_changed:
            self._queue.append((n_bytes, work))
            self._queue_bytes += n_bytes
            self._queue_changed.notify_all()

    def _run(self) -> None:
        self._guarded(self._enforce_limits)
        flush_at_s, enforce_at_s = 0.0, time.monotonic() + _ENFORCE_LIMITS_S
        while not self._closing or self._queue:
            self._do_next()
            now_s = time.monotonic()
            if now_s >= flush_at_s:
                flush_at_s = now_s + self._settings.flush_s
                self._flush()
            if now_s >= enforce_at_s:
                enforce_at_s = now_s + _ENFORCE_LIMITS_S
                self._guarded(self._enforce_limits)
        for id, opened in list(self._files.items()):
            self._guarded(partial(self._end, id, opened, {}))

    def _do_next(self) -> None:
        """Does the work that waits longest, or waits a little for some."""
        with self._queue_changed:
            if not self._queue and not self._closing:
                self._queue_changed.wait(timeout=self._settings.flush_s / 2)
            if not self._queue:
                return
            n_bytes, work = self._queue.popleft()
        self._guarded(work)
        with self._queue_changed:
            self._queue_bytes -= n_bytes

    def _guarded(self, work: Callable[[], None]) -> None:
        """Does something whose failure must not end the thread."""
        try:
            work()
        except OSError as error:
            self._node.warn_seldom("recordings can't be kept", error=str(error))
        except Exception as error:  # a bug must cost one message, not all that follow
            self._node.warn_seldom("a message can't be recorded", error=f"{type(error).__name__}: {error}")

    def _begin(self, id: str, facts: Mapping[str, str]) -> None:
        try:
            self._enforce_limits()
            self._check_free_space()
            opened = self._files[id] = _OpenRecording(RecordingFile(self._folder.path_of(id)))
            opened.file.add_metadata(BEGIN, facts)
            self.problem = ""
            self._node.log.info("recording", id=id)
        except OSError as error:
            self._fail(id, error)

    def _with_file(self, id: str, work: Callable[[_OpenRecording], object]) -> None:
        """Does something with a file that is still being written; ends the recording if the disk fails."""
        opened = self._files.get(id)
        if opened is None:
            return
        try:
            work(opened)
        except OSError as error:
            self._fail(id, error)

    def _record(self, ids: Collection[str], message: BusMessage) -> None:
        def write(opened: _OpenRecording) -> None:
            for converted in opened.converter.convert(message):
                opened.file.write(converted)

        for id in ids:
            self._with_file(id, write)

    def _end(self, id: str, opened: _OpenRecording, facts: Mapping[str, str]) -> None:
        if facts:
            opened.file.add_metadata(END, facts)
        opened.file.finish()
        del self._files[id]
        self._node.log.info("recorded", id=id, mb=round(opened.file.n_bytes / 2**20, 1), complete=bool(facts))
        self._enforce_limits()

    def _end_or_forget(self, id: str, facts: Mapping[str, str]) -> None:
        """Ends a recording. If it had failed, forgets it, and the problem as well if there is free space again."""
        self._with_file(id, lambda opened: self._end(id, opened, facts))
        if self.failed.pop(id, None) is not None and not self.failed:
            self._check_free_space()
            self.problem = ""

    def _flush(self) -> None:
        for id in list(self._files):
            self._with_file(id, self._flush_one)
        self._guarded(self._measure)

    def _measure(self) -> None:
        self.n_bytes, self.free_bytes = sum(f.n_bytes for f in self._folder.files()), self._folder.free_bytes()

    def _flush_one(self, opened: _OpenRecording) -> None:
        opened.file.flush()
        self._check_free_space()

    def _check_free_space(self) -> None:
        """Raises OSError if less than ``min_free_mb`` is left on the disk."""
        least = self._settings.min_free_mb << 20
        if (free := self._folder.free_bytes()) < least:
            raise OSError(f"{free >> 20} MB are left on the disk of {self._folder.path}, less than min_free_mb")

    def _enforce_limits(self) -> None:
        for id in self._folder.enforce(self._limits, clock_ns()):
            self._node.log.info("deleted an old recording", id=id)

    def _fail(self, id: str, error: OSError) -> None:
        """Ends a recording because the disk failed; its mission goes on."""
        opened = self._files.pop(id, None)
        if opened is not None:
            with suppress(OSError):
                opened.file.abandon()
        self.problem = f"recording stopped: {error}. Make room, or set SURVEILNAV_RECORDER__FOLDER to another disk"
        self.failed[id] = str(error)
        self._node.log.error("recording stopped", id=id, error=str(error))
