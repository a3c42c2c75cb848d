"""The stores in a folder: which files they are, copies of them while services write, and whether a service uses one."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from surveilnav.errors import ConfigError

_SQLITE = b"SQLite format 3\0"
#: What SQLite keeps beside a file while somebody uses it; a copy doesn't need it, and it would spoil another file.
COMPANIONS = ("-wal", "-shm", "-journal")
_PAGES_PER_STEP = 2048


def store_files(folder: Path) -> list[Path]:
    """The files in a folder that belong into a backup, without those that services have set aside as unusable."""
    found = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.is_symlink()]
    visible = [path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts)]
    return [path for path in visible if not path.name.endswith(COMPANIONS) and not is_set_aside(path)]


def is_set_aside(path: Path) -> bool:
    """Whether a service has moved this file, or its companion, aside: "fusion.sqlite.corrupt" is no store any more."""
    return ".sqlite." in path.name


def is_sqlite(path: Path) -> bool:
    """Whether a file is of SQLite."""
    with path.open("rb") as file:
        return file.read(len(_SQLITE)) == _SQLITE


class StoreCopies:
    """Copies of SQLite stores as they all were at one moment, however long copying takes and whatever is written meanwhile."""

    def __init__(self, stores: list[Path]) -> None:
        """Holds the moment. ConfigError: a store is damaged, or can't be read."""
        self._open: dict[Path, sqlite3.Connection] = {}
        for path in stores:
            with _named(path):
                self._open[path] = db = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=10.0)
                db.isolation_level = None
                # In WAL mode an open transaction reads what was there when it began, and keeps nobody from writing.
                db.execute("BEGIN")
                db.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()

    def contents(self, path: Path) -> dict[str, Any]:
        """What is in a store, as numbers: of missions, or of views and snapshots."""
        db = self._open[path]
        with _named(path):
            tables = {name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if "missions" in tables:
                n, n_open = db.execute("SELECT COUNT(*), COALESCE(SUM(finished = 0), 0) FROM missions").fetchone()
                return {"missions": n, "missions_open": n_open}
            if {"view", "snapshot"} <= tables:
                views, newest = db.execute("SELECT COUNT(*), COALESCE(MAX(number), 0) FROM view").fetchone()
                (snapshots,) = db.execute("SELECT COUNT(*) FROM snapshot").fetchone()
                return {"views": views, "newest_view": newest, "snapshots": snapshots}
        return {}

    def copy(self, path: Path, target: Path, on_bytes: Callable[[int], None]) -> None:
        """Writes a copy of a store to ``target``. ConfigError: the store is damaged."""
        source, copied = self._open[path], 0
        (page_bytes,) = source.execute("PRAGMA page_size").fetchone()

        def on_step(status: int, left: int, total: int) -> None:
            nonlocal copied
            done = (total - left) * page_bytes
            on_bytes(done - copied)
            copied = done

        with _named(path):
            db = sqlite3.connect(target)
            try:
                source.backup(db, pages=_PAGES_PER_STEP, progress=on_step)
                if db.execute("PRAGMA quick_check(1)").fetchone()[0] != "ok":
                    raise ConfigError(f"the store {path} is damaged: restart its service, which sets it aside")
            finally:
                db.close()

    def close(self) -> None:
        for db in self._open.values():
            db.close()


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turns SQLite's errors into one that names the file."""
    try:
        yield
    except sqlite3.Error as error:
        raise ConfigError(f"the store {path} can't be read: {error}") from error


def is_in_use(store: Path) -> bool:
    """Whether a process has an SQLite store open. A service has its store open for as long as it runs."""
    with suppress(FileNotFoundError):
        if not is_sqlite(store):
            return False
    try:
        db = sqlite3.connect(f"{store.resolve().as_uri()}?mode=rw", uri=True, timeout=0.2, isolation_level=None)
        try:
            db.execute("PRAGMA locking_mode = EXCLUSIVE")
            db.execute("BEGIN EXCLUSIVE")
            db.execute("ROLLBACK")
        finally:
            db.close()
    except sqlite3.OperationalError as error:
        return "locked" in str(error)
    except sqlite3.DatabaseError:  # damaged: nobody can use it
        return False
    return False
