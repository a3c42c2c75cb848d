"""What fusion must not lose: an append-only log of views, snapshots of the maps, and every event of every object.

One SQLite file. A view is committed here before the maps take it and long before a revision names it; a snapshot
makes the log before it superfluous. The two newest snapshots and the log since the older one are kept, so a snapshot
that can't be read costs time and no view. A killed process loses nothing; synchronous=NORMAL leaves it to the operating
system when a committed view reaches the disk, so a power cut may take the last ones.
"""

from __future__ import annotations

import glob
import shutil
import sqlite3
import threading
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from surveilnav.messages.maps import ObjectEvent

_FORMAT = 1
_CHUNK = 4 << 20  # a snapshot goes in by pieces, so that a view never waits for all of it
_SCHEMA = """
CREATE TABLE IF NOT EXISTS view (
    number INTEGER PRIMARY KEY AUTOINCREMENT, source TEXT, view INTEGER, header BLOB, payload BLOB, reply BLOB,
    digest BLOB, fault TEXT, checksum INTEGER);
CREATE TABLE IF NOT EXISTS snapshot (id INTEGER PRIMARY KEY AUTOINCREMENT, up_to INTEGER, pieces INTEGER, checksum INTEGER);
CREATE TABLE IF NOT EXISTS piece (snapshot INTEGER, k INTEGER, data BLOB, PRIMARY KEY (snapshot, k));
CREATE TABLE IF NOT EXISTS event (
    number INTEGER, k INTEGER, floor TEXT, object INTEGER, absorbed INTEGER, data BLOB, PRIMARY KEY (number, k));
CREATE INDEX IF NOT EXISTS event_of ON event (floor, object);
"""
_FAMILY = """
WITH RECURSIVE family(id) AS (
    SELECT ?2 UNION SELECT absorbed FROM event JOIN family ON object = id WHERE floor = ?1 AND absorbed > 0)
SELECT data FROM event WHERE floor = ?1 AND object IN family ORDER BY number, k
"""


class StoreError(Exception):
    """The file can't be read or written; ``name``: unwritable, corrupt or other_version."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name = name


@dataclass(frozen=True, slots=True)
class Entry:
    """A view as it arrived, and what perception replied. ``fault``: why it was of no use; then nothing else matters."""

    source: str
    view: int
    header: bytes
    payload: bytes = b""
    reply: bytes = b""
    digest: bytes = b""
    fault: str = ""

    @property
    def checksum(self) -> int:
        """CRC-32 of all bytes."""
        crc = 0
        for part in (self.source.encode(), self.header, self.payload, self.reply, self.digest, self.fault.encode()):
            crc = zlib.crc32(part, crc)
        return crc


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """One line of an object's history.

    ``number``: of the view that caused it, in the log; ``k``: its place among the events of that view.
    """

    number: int
    k: int
    floor: str
    object_id: int
    absorbed: int
    event: ObjectEvent


class Store:
    """The file at ``path``; safe to use from any thread. Opened when first needed, and again after a failure."""

    def __init__(self, path: Path, *, max_events: int = 1_000_000, max_pages: int = 0, overwrite: bool = False) -> None:
        """``overwrite``: what is deleted is overwritten, so that nobody finds it in the file."""
        self.path, self._overwrite = path, overwrite
        self._max_events, self._max_pages = max_events, max_pages
        self._lock = threading.RLock()
        self._connection: sqlite3.Connection | None = None

    def append(self, entries: Sequence[Entry]) -> list[int]:
        """Commits views to the log; returns their numbers. StoreError: not one of them was written."""
        with self._writing() as db:
            return [
                int(
                    db.execute(
                        "INSERT INTO view (source, view, header, payload, reply, digest, fault, checksum)"
                        " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                        (e.source, e.view, e.header, e.payload, e.reply, e.digest, e.fault, e.checksum),
                    ).lastrowid
                    or 0
                )
                for e in entries
            ]

    def log(self, after: int) -> Iterator[tuple[int, Entry | None]]:
        """The views logged after number ``after``, oldest first; None for one that is damaged. StoreError."""
        while True:
            with self._reading() as db:
                row = db.execute(
                    "SELECT number, source, view, header, payload, reply, digest, fault, checksum FROM view"
                    " WHERE number > ? ORDER BY number LIMIT 1",
                    (after,),
                ).fetchone()
            if row is None:
                return
            after, *fields, checksum = row
            yield after, _entry(fields, checksum)

    def newest(self, source: str, view: int, limit: int) -> list[Entry]:
        """The views of a source that are logged still, newest first, at most so many; damaged ones left out. StoreError."""
        with self._reading() as db:
            rows = db.execute(
                "SELECT source, view, header, payload, reply, digest, fault, checksum FROM view"
                " WHERE source = ? AND view = ? ORDER BY number DESC LIMIT ?",
                (source, view, limit),
            ).fetchall()
        return [entry for *fields, checksum in rows if (entry := _entry(fields, checksum)) is not None]

    def add_events(self, events: Iterable[StoredEvent]) -> None:
        """Commits events; those that came before, with the same numbers, stay. StoreError."""
        rows = [(e.number, e.k, e.floor, e.object_id, e.absorbed, msgspec.msgpack.encode(e.event)) for e in events]
        with self._writing() as db:
            db.executemany("INSERT OR IGNORE INTO event VALUES (?, ?, ?, ?, ?, ?)", rows)

    def history(self, floor: str, object_id: int) -> list[ObjectEvent]:
        """Every event of an object and of those that were found to be the same, oldest first. StoreError."""
        with self._reading() as db:
            rows = db.execute(_FAMILY, (floor, object_id)).fetchall()
        return [_EVENT.decode(data) for (data,) in rows]

    def save(self, snapshot: bytes, up_to: int) -> None:
        """Keeps a snapshot that holds the log up to a number, and drops what it makes superfluous. StoreError."""
        pieces = [snapshot[i : i + _CHUNK] for i in range(0, len(snapshot), _CHUNK)]
        with self._writing() as db:
            db.execute("DELETE FROM piece WHERE snapshot NOT IN (SELECT id FROM snapshot)")  # of one that never ended
            newest = db.execute("SELECT COALESCE(MAX(id), 0) FROM snapshot").fetchone()[0]
        for k, data in enumerate(pieces):
            with self._writing() as db:
                db.execute("INSERT INTO piece VALUES (?, ?, ?)", (newest + 1, k, data))
        with self._writing() as db:
            db.execute(
                "INSERT INTO snapshot VALUES (?, ?, ?, ?)", (newest + 1, up_to, len(pieces), zlib.crc32(snapshot))
            )
            db.execute("DELETE FROM snapshot WHERE id < ?", (newest,))
            db.execute("DELETE FROM piece WHERE snapshot < ?", (newest,))
            db.execute(
                "DELETE FROM view WHERE number <= (SELECT CASE WHEN COUNT(*) > 1 THEN MIN(up_to) END FROM snapshot)"
            )
            excess = db.execute("SELECT COUNT(*) FROM event").fetchone()[0] - self._max_events
            if excess > 0:
                db.execute(
                    "DELETE FROM event WHERE rowid IN (SELECT rowid FROM event ORDER BY number, k LIMIT ?)", (excess,)
                )
        with self._reading() as db:
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def snapshots(self) -> Iterator[tuple[int, bytes | None]]:
        """(number up to which it holds the log, its bytes) of the snapshots, newest first; None: damaged. StoreError."""
        with self._reading() as db:
            rows = db.execute("SELECT id, up_to, pieces, checksum FROM snapshot ORDER BY id DESC").fetchall()
        for id, up_to, n_pieces, checksum in rows:
            try:
                with self._reading() as db:
                    pieces = db.execute("SELECT data FROM piece WHERE snapshot = ? ORDER BY k", (id,)).fetchall()
            except StoreError:
                pieces = []
            data = b"".join(piece for (piece,) in pieces)
            whole = len(pieces) == n_pieces and zlib.crc32(data) == checksum
            yield up_to, data if whole else None

    def wipe(self) -> None:
        """Has nothing left in the file that was deleted, now and from here on. StoreError."""
        self.close()  # it is opened anew with the new setting
        self._overwrite = True
        with self._reading() as db:
            db.execute("VACUUM")
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def drop_aside(self, before_s: float) -> int:
        """Removes what was set aside before a time [s since the epoch]; how many files. StoreError."""
        ours = {self.path.name + ending for ending in ("", "-wal", "-shm", "-journal")}
        removed = 0
        try:
            for aside in self.path.parent.glob(f"{glob.escape(self.path.name)}.*"):
                if aside.name not in ours and aside.stat().st_mtime < before_s:
                    aside.unlink(missing_ok=True)
                    removed += 1
        except OSError as error:
            raise StoreError(
                "unwritable", f"what was set aside beside {self.path} can't be removed: {error}"
            ) from error
        return removed

    def set_aside(self, reason: str, *, copy: bool = False) -> Path:
        """Moves or copies the file out of the way, in the place of what went there before; returns where to. StoreError."""
        self.close()
        aside = self.path.with_name(f"{self.path.name}.{reason}")
        try:
            if self.path.exists():  # SQLite would read the old file's log with the new one
                for ending in ("-wal", "-shm"):
                    aside.with_name(aside.name + ending).unlink(missing_ok=True)
            for ending in ("", "-wal", "-shm"):
                old = self.path.with_name(self.path.name + ending)
                if old.exists():
                    new = aside.with_name(aside.name + ending)
                    if copy:
                        shutil.copy(old, new)
                    else:
                        old.replace(new)
        except OSError as error:
            raise StoreError("unwritable", f"{self.path} can't be moved aside: {error}") from error
        return aside

    def close(self) -> None:
        """Closes the file."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
                self._connection = None

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            try:
                if self._connection is None:
                    self._connection = self._open()
                yield self._connection
            except (sqlite3.OperationalError, OSError) as error:  # full, locked, not there, not ours
                self.close()
                raise StoreError("unwritable", f"{self.path}: {error}") from error
            except sqlite3.DatabaseError as error:
                self.close()
                if type(error) is not sqlite3.DatabaseError:  # a mistake of this program
                    raise
                raise StoreError("corrupt", f"{self.path}: {error}") from error

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction."""
        with self._reading() as db, db:
            db.execute("BEGIN IMMEDIATE")
            yield db

    def _open(self) -> sqlite3.Connection:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        db = sqlite3.connect(self.path, timeout=10.0, isolation_level=None, check_same_thread=False)
        db.text_factory = bytes  # text that is damaged must not look like a disk that can't be read
        try:
            for pragma in ("journal_mode=WAL", "synchronous=NORMAL", f"journal_size_limit={64 << 20}"):
                db.execute(f"PRAGMA {pragma}")
            db.execute(f"PRAGMA secure_delete={'ON' if self._overwrite else 'OFF'}")
            if self._max_pages:
                db.execute(f"PRAGMA max_page_count={self._max_pages}")
            version = db.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, _FORMAT):
                raise StoreError("other_version", f"{self.path} has format {version}, this program writes {_FORMAT}")
            if version == 0:
                db.executescript(f"{_SCHEMA} PRAGMA user_version={_FORMAT};")
        except BaseException:
            db.close()
            raise
        return db


_EVENT = msgspec.msgpack.Decoder(ObjectEvent)


def _entry(fields: list[Any], checksum: int) -> Entry | None:
    """A row of the log; None if its bytes aren't those that were written."""
    try:
        source, view, header, payload, reply, digest, fault = fields
        entry = Entry(source.decode(), view, header, payload, reply, digest, fault.decode())
        return entry if entry.checksum == checksum else None
    except (TypeError, AttributeError, UnicodeDecodeError):
        return None
