"""Who was shown which camera, and when: appended to files, one line per access, and never a picture.

    {"time":"2026-01-31T10:00:41Z","client":"10.0.0.12","camera":"c0-1","view":3,"what":"latest","key":"anna"}

A client that keeps watching is recorded once a minute. A new file is begun every day, and when the current one is full. Files
are removed when they are too old, or when all together are too large. The newest lines are also kept in memory; without a
folder, only there.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated

import msgspec
import structlog
from starlette.requests import HTTPConnection

from surveilnav.rest import AccessRecord
from surveilnav.services.gateway.core.hosts import Networks
from surveilnav.services.gateway.requester import address_of, person_of

#: The view of an access to all of a camera's views.
ALL_VIEWS = -1
_REPEAT_S = 60.0
#: Pause before lines are written again for which the disk had no room.
_RETRY_S = 2.0
_MAX_LINES, _MAX_CLIENTS = 10_000, 10_000
_FILE_BYTES = 1 << 20
_NAME = "looks-%Y%m%dT%H%M%S.%fZ.jsonl"


class LogLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line of a file. ``what`` was shown: "thumbnail", "latest", "tile", "history" or "recording"; ``client``: an address;
    ``key``: the name of the client's key, empty where none was needed."""

    time: Annotated[datetime, msgspec.Meta(tz=True)]
    client: str
    camera: str
    view: int
    what: str
    key: str = ""


class AccessLog:
    """Records who is shown cameras' pictures. All code that shows a picture must call ``record`` each time. Thread-safe.

    Args:
        folder: the folder of the files; None: there are no files.
        keep: how long a line is kept. Files may keep it for about a day longer.
        max_bytes: maximum size of all files together.
        trusted_proxies: proxies whose ``X-Forwarded-For`` is believed.
        report_problem: called with why files can't be written, and with "" once they can.
    """

    def __init__(
        self,
        folder: Path | None = None,
        *,
        keep: timedelta = timedelta(days=90),
        max_bytes: int = 10 << 20,
        trusted_proxies: Networks = (),
        report_problem: Callable[[str], None] = lambda why: None,
    ) -> None:
        self._folder, self._keep, self._max_bytes = folder, keep, max_bytes
        self._trusted_proxies, self._report_problem = trusted_proxies, report_problem
        self._failed: deque[LogLine] = deque(maxlen=_MAX_LINES)  # to be written once the disk has room
        self._lines: deque[LogLine] = deque(maxlen=_MAX_LINES)
        self._recorded_s: OrderedDict[tuple[object, ...], float] = OrderedDict()
        self._file: Path | None = None
        self._lock, self._disk = threading.Lock(), threading.Lock()
        self._log = structlog.get_logger()
        self._unwritten: queue.Queue[LogLine] = queue.Queue(_MAX_LINES)
        if folder is not None:
            self._lines.extend(_read(_files(folder)))
            threading.Thread(target=self._write_all, args=(folder,), name="access log", daemon=True).start()

    def record(self, request: HTTPConnection, camera: str, view: int, what: str) -> None:
        """Records that the client that sent ``request`` is shown a view now. ``what``: as in ``LogLine``."""
        person = person_of(request)
        self.add(address_of(request, self._trusted_proxies), camera, view, what, key=person.name if person else "")

    def add(
        self, client: str, camera: str, view: int, what: str, now: datetime | None = None, *, key: str = ""
    ) -> None:
        """Records an access, unless the same was recorded within a minute. Never waits for the disk: another thread writes."""
        now = now or datetime.now(UTC)
        with self._lock:
            if not self._is_new((client, key, camera, view, what)):
                return
            line = LogLine(now, client, camera, view, what, key)
            self._lines.append(line)
        if self._folder is not None:
            try:
                self._unwritten.put_nowait(line)
            except queue.Full:
                self._log.error("an access to a camera can't be written down: the disk is too slow", camera=camera)

    def records_of(self, camera: str, now: datetime | None = None) -> list[AccessRecord]:
        """The newest accesses to a camera, newest first; empty for a camera that nobody knows."""
        oldest = (now or datetime.now(UTC)) - self._keep
        with self._lock:
            lines = [line for line in reversed(self._lines) if line.camera == camera and line.time >= oldest]
        return [
            AccessRecord(time=line.time, client=line.client, key=line.key, view=line.view, what=line.what)
            for line in lines
        ]

    def remove_old_files(self, now: datetime | None = None) -> None:
        """Removes files whose lines are too old. To be called regularly, since there may be no access for months."""
        now = now or datetime.now(UTC)
        if self._folder is None:
            return
        with self._disk:
            try:
                self._drop_old(self._folder, now)
            except OSError as error:
                self._log.error(
                    "old files of the access log can't be removed", folder=str(self._folder), error=str(error)
                )

    def _is_new(self, access: tuple[object, ...]) -> bool:
        now_s = time.monotonic()
        if now_s - self._recorded_s.get(access, -_REPEAT_S) < _REPEAT_S:
            return False
        self._recorded_s[access] = now_s
        self._recorded_s.move_to_end(access)
        while len(self._recorded_s) > _MAX_CLIENTS:
            self._recorded_s.popitem(last=False)
        return True

    # --- files ----------------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Waits until all that was recorded is in files."""
        self._unwritten.join()

    def _write_all(self, folder: Path) -> None:
        while True:
            try:
                line = self._unwritten.get(timeout=_RETRY_S if self._failed else None)
            except queue.Empty:
                self._write_failed(folder)
                continue
            self._write_failed(folder)
            if self._failed or not self._write(folder, line):
                self._failed.append(line)
            self._unwritten.task_done()

    def _write_failed(self, folder: Path) -> None:
        """Writes the lines that couldn't be written so far, as far as that goes now."""
        while self._failed and self._write(folder, self._failed[0]):
            self._failed.popleft()

    def _write(self, folder: Path, line: LogLine) -> bool:
        """Appends a line; whether that worked. If not, an error is logged and pictures are still shown."""
        with self._disk:
            return self._append(folder, line)

    def _append(self, folder: Path, line: LogLine) -> bool:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if self._file is None or self._is_full(self._file, line.time):
                self._file = folder / line.time.strftime(_NAME)
                self._drop_old(folder, line.time)
            with self._file.open("ab") as file:
                # after a line that was cut off, one begins anew; empty lines are passed over
                file.write((b"\n" if self._failed else b"") + msgspec.json.encode(line) + b"\n")
        except OSError as error:
            if not self._failed:
                self._log.error("an access to a camera can't be written down", folder=str(folder), error=str(error))
            self._report_problem(f"who looked at pictures can't be written down in {folder}: {error}")
            return False
        self._report_problem("")
        return True

    @staticmethod
    def _is_full(file: Path, now: datetime) -> bool:
        return _began(file).date() != now.date() or not file.exists() or file.stat().st_size >= _FILE_BYTES

    def _drop_old(self, folder: Path, now: datetime) -> None:
        """Removes files whose lines are all older than ``keep``, and the oldest files while all together are too large."""
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


def _read(files: Iterable[Path]) -> Iterable[LogLine]:
    """The lines of files. Lines that a crash or a person left broken are skipped."""
    for file in files:
        try:
            lines = file.read_bytes().splitlines()
        except OSError:
            continue
        for line in lines:
            try:
                yield msgspec.json.decode(line, type=LogLine)
            except msgspec.DecodeError:
                continue
