"""Who looked at which camera, and when: appended to files, a line a look, and never a picture.

    {"time":"2026-01-31T10:00:41Z","client":"10.0.0.12","camera":"c0-1","view":3,"what":"latest"}

Who goes on looking is noted once a minute. Files are begun daily and when one is full; the oldest go when they are too
old or too many. The newest lines are kept in memory, too: without a folder there alone.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import structlog

from surveilnav.services.gateway.core.looks import Look

_AGAIN_S = 60.0
_MOST_LINES, _MOST_WATCHERS = 10_000, 10_000
_FILE_BYTES = 1 << 20
_NAME = "looks-%Y%m%dT%H%M%S.%fZ.jsonl"


class AccessLog:
    """Looks at cameras. Safe to use from any thread.

    Args:
        folder: where the files go; None: nowhere.
        keep: how long a line is kept, about a day more in files.
        max_bytes: of all files.
    """

    def __init__(
        self, folder: Path | None = None, *, keep: timedelta = timedelta(days=90), max_bytes: int = 10 << 20
    ) -> None:
        self._folder, self._keep, self._max_bytes = folder, keep, max_bytes
        self._lines: deque[Look] = deque(maxlen=_MOST_LINES)
        self._watched_s: OrderedDict[tuple[object, ...], float] = OrderedDict()
        self._file: Path | None = None
        self._lock, self._disk = threading.Lock(), threading.Lock()
        self._log = structlog.get_logger()
        self._unwritten: queue.Queue[Look] = queue.Queue(_MOST_LINES)
        if folder is not None:
            self._lines.extend(_read(_files(folder)))
            threading.Thread(target=self._write_all, args=(folder,), name="access log", daemon=True).start()

    def note(self, client: str, camera: str, view: int, what: str, now: datetime | None = None) -> None:
        """Notes that ``client`` was shown a view of a camera; the same again within a minute is one look. The disk is another
        thread's: whoever shows pictures never waits for it."""
        now = now or datetime.now(UTC)
        with self._lock:
            if not self._is_new((client, camera, view, what)):
                return
            look = Look(now, client, camera, view, what)
            self._lines.append(look)
        if self._folder is not None:
            try:
                self._unwritten.put_nowait(look)
            except queue.Full:
                self._log.error("a look at a camera can't be written down: the disk is too slow", camera=camera)

    def of(self, camera: str, now: datetime | None = None) -> list[Look]:
        """The newest looks at a camera, newest first."""
        oldest = (now or datetime.now(UTC)) - self._keep
        with self._lock:
            return [look for look in reversed(self._lines) if look.camera == camera and look.time >= oldest]

    def tidy(self, now: datetime | None = None) -> None:
        """Removes files of lines that are too old, also where nobody looks any more."""
        now = now or datetime.now(UTC)
        if self._folder is None:
            return
        with self._disk:
            try:
                self._drop_old(self._folder, now)
            except OSError as error:
                self._log.error("old looks can't be removed", folder=str(self._folder), error=str(error))

    def _is_new(self, watcher: tuple[object, ...]) -> bool:
        now_s = time.monotonic()
        if now_s - self._watched_s.get(watcher, -_AGAIN_S) < _AGAIN_S:
            return False
        self._watched_s[watcher] = now_s
        self._watched_s.move_to_end(watcher)
        while len(self._watched_s) > _MOST_WATCHERS:
            self._watched_s.popitem(last=False)
        return True

    # --- files ----------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """Waits until all that was noted is in files."""
        self._unwritten.join()

    def _write_all(self, folder: Path) -> None:
        while True:
            look = self._unwritten.get()
            with self._disk:
                self._write(folder, look)
            self._unwritten.task_done()

    def _write(self, folder: Path, look: Look) -> None:
        """Appends a line. A disk that can't be written costs the lines on it, and is said: people may have to see."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if self._file is None or self._is_full(self._file, look.time):
                self._file = folder / look.time.strftime(_NAME)
                self._drop_old(folder, look.time)
            with self._file.open("ab") as file:
                file.write(msgspec.json.encode(look) + b"\n")
        except OSError as error:
            self._log.error("a look at a camera can't be written down", folder=str(folder), error=str(error))

    @staticmethod
    def _is_full(file: Path, now: datetime) -> bool:
        return _began(file).date() != now.date() or not file.exists() or file.stat().st_size >= _FILE_BYTES

    def _drop_old(self, folder: Path, now: datetime) -> None:
        """Removes files that ended before what is kept, and the oldest while all are too large."""
        files = _files(folder)
        sizes = {file: file.stat().st_size for file in files}
        for file, following in zip(files, [*files[1:], None], strict=False):
            ended = _began(following) if following else _began(file) + timedelta(days=1)
            if now - ended > self._keep or sum(sizes.values()) + _FILE_BYTES > self._max_bytes:
                del sizes[file]
                file.unlink(missing_ok=True)


def _began(file: Path) -> datetime:
    return datetime.strptime(file.name, _NAME).replace(tzinfo=UTC)


def _files(folder: Path) -> list[Path]:
    """The log's files, the oldest first."""
    found = []
    for path in folder.glob("looks-*.jsonl"):
        try:
            datetime.strptime(path.name, _NAME)
        except ValueError:
            continue  # not ours
        found.append(path)
    return sorted(found)


def _read(files: Iterable[Path]) -> Iterable[Look]:
    """Their lines; what a crash or a hand left broken is left out."""
    for file in files:
        try:
            lines = file.read_bytes().splitlines()
        except OSError:
            continue
        for line in lines:
            try:
                yield msgspec.json.decode(line, type=Look)
            except msgspec.DecodeError:
                continue
