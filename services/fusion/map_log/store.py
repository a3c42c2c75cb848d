"""An SQLite file with everything that fusion mustn't lose: a log of views, snapshots of the maps, and the events of objects.

A view is committed here before it is integrated. A snapshot makes the log before it superfluous for a restart. The two newest
snapshots are kept, and the log since the older one, so if the newest can't be read, the maps can still be restored, which only
takes longer. As far as there is room, older views and snapshots are kept too (``retention``), from which the maps can be computed
again without the views of one source (``removal``).
If the process is killed, nothing is lost. With synchronous=NORMAL, the operating system decides when a committed view reaches the
disk, so a power cut may lose the newest ones.
"""

from __future__ import annotations

import glob
import shutil
import sqlite3
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from surveilnav.messages.maps import ObjectEvent
from surveilnav.services.fusion.map_log.removal import Removal, SnapshotContents
from surveilnav.services.fusion.map_log.retention import NO_RETENTION, Retention, oldest_base, superfluous_snapshots

_FORMAT = 1
_PIECE_BYTES = 4 << 20  # a snapshot is written in pieces, so that views can be committed in between
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
#: Tables that files of the same format didn't have at first.
_LATER_TABLES = """
CREATE TABLE IF NOT EXISTS contents (snapshot INTEGER PRIMARY KEY, data BLOB);
CREATE TABLE IF NOT EXISTS removal (id INTEGER PRIMARY KEY AUTOINCREMENT, data BLOB);
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
    """A view as it arrived, with perception's reply. ``fault``: why the picture couldn't be used; then it must not be decoded."""

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
    """An event of an object.

    Attributes:
        number: number in the log of the view that caused it.
        k: its position among the events of that view.
        absorbed: id of the object that was merged into this one; 0 if none was.
    """

    number: int
    k: int
    floor: str
    object_id: int
    absorbed: int
    event: ObjectEvent


class Store:
    """The file at ``path``. It is opened when first needed, and again after a failure. Safe from any thread."""

    def __init__(self, path: Path, *, max_events: int = 1_000_000, max_pages: int = 0, overwrite: bool = False) -> None:
        """``overwrite``: whether deleted content is overwritten, so that it can't be recovered from the file."""
        self.path, self._overwrite = path, overwrite
        self._max_events, self._max_pages = max_events, max_pages
        self._lock = threading.RLock()
        self._connection: sqlite3.Connection | None = None

    def append(self, entries: Sequence[Entry]) -> list[int]:
        """Commits views to the log; returns their numbers. StoreError: none of them was written."""
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
        """The views logged after number ``after``, oldest first; None for one that is damaged. Raises StoreError."""
        while True:
            with self._reading() as db:
                row = db.execute(
                    "SELECT number, source, view, header, payload, reply, digest, fault, checksum FROM view"
                    " WHERE number > ? ORDER BY number LIMIT 1",
                    (after,),
                ).fetchone()
            if row is None:
                return
            number, *fields, checksum = row
            if number <= after:  # a damaged index leads back: there would be no end
                raise StoreError("corrupt", f"{self.path}: after view {after} comes view {number}")
            after = number
            yield after, _entry(fields, checksum)

    def newest(self, source: str, view: int, limit: int) -> list[Entry]:
        """At most ``limit`` logged views of a source, newest first, without damaged ones. Raises StoreError."""
        with self._reading() as db:
            rows = db.execute(
                "SELECT source, view, header, payload, reply, digest, fault, checksum FROM view"
                " WHERE source = ? AND view = ? ORDER BY number DESC LIMIT ?",
                (source, view, limit),
            ).fetchall()
        return [entry for *fields, checksum in rows if (entry := _entry(fields, checksum)) is not None]

    def add_events(self, events: Iterable[StoredEvent]) -> None:
        """Commits events. Events with the same numbers that are stored already stay as they are. Raises StoreError."""
        rows = [(e.number, e.k, e.floor, e.object_id, e.absorbed, msgspec.msgpack.encode(e.event)) for e in events]
        with self._writing() as db:
            db.executemany("INSERT OR IGNORE INTO event VALUES (?, ?, ?, ?, ?, ?)", rows)

    def history(self, floor: str, object_id: int) -> list[ObjectEvent]:
        """All events of an object and of the objects that were merged into it, oldest first. Raises StoreError."""
        with self._reading() as db:
            rows = db.execute(_FAMILY, (floor, object_id)).fetchall()
        return [_EVENT.decode(data) for (data,) in rows]

    def replace_events(self, after: int, events: Iterable[StoredEvent]) -> None:
        """Replaces all events that views after number ``after`` have caused. Raises StoreError."""
        rows = [(e.number, e.k, e.floor, e.object_id, e.absorbed, msgspec.msgpack.encode(e.event)) for e in events]
        with self._writing() as db:
            db.execute("DELETE FROM event WHERE number > ?", (after,))
            db.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?)", rows)

    def save(
        self,
        snapshot: bytes,
        up_to: int,
        contents: SnapshotContents | None = None,
        retention: Retention = NO_RETENTION,
    ) -> None:
        """Saves a snapshot that contains the log up to number ``up_to``; deletes what is superfluous then. Raises StoreError.

        ``retention``: how much of the log is kept beyond what a restart needs.
        """
        pieces = [snapshot[i : i + _PIECE_BYTES] for i in range(0, len(snapshot), _PIECE_BYTES)]
        with self._writing() as db:
            db.execute(
                "DELETE FROM piece WHERE snapshot NOT IN (SELECT id FROM snapshot)"
            )  # of a snapshot that wasn't finished
            newest = db.execute("SELECT COALESCE(MAX(id), 0) FROM snapshot").fetchone()[0]
        for k, data in enumerate(pieces):
            with self._writing() as db:
                db.execute("INSERT INTO piece VALUES (?, ?, ?)", (newest + 1, k, data))
        row = newest + 1, up_to, len(pieces), zlib.crc32(snapshot)
        with self._writing() as db:
            db.execute("INSERT INTO snapshot VALUES (?, ?, ?, ?)", row)
            db.execute("INSERT OR REPLACE INTO contents VALUES (?, ?)", (newest + 1, msgspec.msgpack.encode(contents)))
            self._delete_superfluous(db, retention)
        with self._reading() as db:
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def _delete_superfluous(self, db: sqlite3.Connection, retention: Retention) -> None:
        """Deletes views, snapshots and events that neither a restart nor ``retention`` needs."""
        kept = dict(db.execute("SELECT id, up_to FROM snapshot ORDER BY id").fetchall())
        if len(kept) > 1:
            first, last = db.execute("SELECT COALESCE(MIN(number), 0), COALESCE(MAX(number), 0) FROM view").fetchone()
            sizes = "SELECT COALESCE(SUM(LENGTH(payload) + LENGTH(reply)), 0) FROM view WHERE number > ?"
            base = oldest_base(
                list(kept.values()), first, last, lambda after: db.execute(sizes, (after,)).fetchone()[0], retention
            )
            db.execute("DELETE FROM view WHERE number <= ?", (base,))
            for id in superfluous_snapshots(kept, base, retention):
                for table, column in (("snapshot", "id"), ("piece", "snapshot"), ("contents", "snapshot")):
                    db.execute(f"DELETE FROM {table} WHERE {column} = ?", (id,))
        excess = db.execute("SELECT COUNT(*) FROM event").fetchone()[0] - self._max_events
        if excess > 0:
            db.execute(
                "DELETE FROM event WHERE rowid IN (SELECT rowid FROM event ORDER BY number, k LIMIT ?)", (excess,)
            )

    def snapshots(self) -> Iterator[tuple[int, SnapshotContents, Callable[[], bytes | None]]]:
        """The snapshots, newest first. Raises StoreError.

        Yields:
            The log number up to which it goes, what is in it, and a function that reads its bytes: None if they are damaged.
        """
        with self._reading() as db:
            rows = db.execute(
                "SELECT id, up_to, pieces, checksum, contents.data FROM snapshot"
                " LEFT JOIN contents ON contents.snapshot = id ORDER BY id DESC"
            ).fetchall()
        for id, up_to, n_pieces, checksum, contents in rows:
            yield up_to, _contents(contents), partial(self._read_snapshot, id, n_pieces, checksum)

    def _read_snapshot(self, id: int, n_pieces: int, checksum: int) -> bytes | None:
        try:
            with self._reading() as db:
                pieces = db.execute("SELECT data FROM piece WHERE snapshot = ? ORDER BY k", (id,)).fetchall()
        except StoreError:
            return None
        data = b"".join(piece for (piece,) in pieces)
        return data if len(pieces) == n_pieces and zlib.crc32(data) == checksum else None

    def first_number(self) -> int:
        """The number of the oldest view in the log; 0 if it is empty. Raises StoreError."""
        with self._reading() as db:
            return int(db.execute("SELECT COALESCE(MIN(number), 0) FROM view").fetchone()[0])

    def put_removal(self, removal: Removal) -> int:
        """Commits a removal, in place of the one with its id; a new one has id 0. Returns its id. Raises StoreError."""
        with self._writing() as db:
            id = removal.id or db.execute("INSERT INTO removal (data) VALUES (NULL)").lastrowid or 0
            data = msgspec.msgpack.encode(replace(removal, id=id))
            db.execute("INSERT OR REPLACE INTO removal VALUES (?, ?)", (id, data))
        return id

    def removals(self) -> list[Removal]:
        """All removals, oldest first. Raises StoreError."""
        with self._reading() as db:
            rows = db.execute("SELECT data FROM removal ORDER BY id").fetchall()
        return [_REMOVAL.decode(data) for (data,) in rows]

    def damage(self) -> str:
        """What SQLite finds wrong with the file; "" if it is sound. Reads all of it: 600 MB in 1 to 5 s. Raises StoreError."""
        with self._reading() as db:
            found = bytes(db.execute("PRAGMA quick_check(1)").fetchone()[0])
        return "" if found == b"ok" else found.decode(errors="replace")[:200]

    def wipe(self) -> None:
        """Overwrites everything in the file that was deleted, now and from now on. Raises StoreError."""
        self.close()  # to be opened again with the new setting
        self._overwrite = True
        with self._reading() as db:
            db.execute("VACUUM")
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def drop_aside(self, before_s: float) -> int:
        """Removes files that ``set_aside`` made before a time [s since the epoch]; returns how many. Raises StoreError."""
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
        """Moves or copies the file to a name that ends in ``reason``; returns the new path. Raises StoreError."""
        self.close()
        aside = self.path.with_name(f"{self.path.name}.{reason}")
        try:
            if self.path.exists():  # otherwise SQLite would apply an older file's write-ahead log to it
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
            except (
                sqlite3.OperationalError,
                OSError,
            ) as error:  # the disk is full, or the file is locked, missing or not writable
                self.close()
                raise StoreError("unwritable", f"{self.path}: {error}") from error
            except (
                sqlite3.DatabaseError,
                UnicodeDecodeError,
            ) as error:  # Unicode: damaged bytes within SQLite's own message
                self.close()
                if type(error) not in (sqlite3.DatabaseError, UnicodeDecodeError):  # an error in this program
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
        db.text_factory = bytes  # damaged text mustn't look like an unreadable disk
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
            db.executescript(_LATER_TABLES)
        except BaseException:
            db.close()
            raise
        return db


_EVENT = msgspec.msgpack.Decoder(ObjectEvent)
_REMOVAL = msgspec.msgpack.Decoder(Removal)
_CONTENTS = msgspec.msgpack.Decoder(SnapshotContents | None)


def _contents(data: bytes | None) -> SnapshotContents:
    """What is known of a snapshot; that it may hold anything, if nothing is."""
    try:
        return (_CONTENTS.decode(data) if data else None) or SnapshotContents()
    except msgspec.DecodeError:
        return SnapshotContents()


def _entry(fields: list[Any], checksum: int) -> Entry | None:
    """A row of the log; None if its bytes aren't those that were written."""
    try:
        source, view, header, payload, reply, digest, fault = fields
        entry = Entry(source.decode(), view, header, payload, reply, digest, fault.decode())
        return entry if entry.checksum == checksum else None
    except (TypeError, AttributeError, UnicodeDecodeError):
        return None
