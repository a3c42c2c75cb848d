"""The records of a run: one SQLite file, one row per episode, whole or not there whenever one looks."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from benchmark.runner.basis import Basis
from benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError

VERSION = 3
_FILE = "episodes.sqlite"
_EPISODES = (
    "(scene TEXT, episode_id TEXT, success INTEGER, spl REAL, reason TEXT, record BLOB NOT NULL, "
    "PRIMARY KEY (scene, episode_id))"
)
_BROKEN = "(scene TEXT, episode_id TEXT, error TEXT, PRIMARY KEY (scene, episode_id))"
_BUSY_S = 60.0


class EpisodeRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One episode. ``bytes``: by tier, what the cameras offered; empty without surveillance. ``path``: x, y [m] after
    every action, in mm. ``seconds``: wall time, the only field that another run may have different."""

    scene: str
    episode_id: str
    category: str
    success: bool
    spl: float
    soft_spl: float
    steps: int
    path_m: float
    shortest_path_m: float
    distance_m: float | None
    reason: str
    message: str
    seen: bool
    floors: list[str]
    invoked: list[str]
    bytes: dict[str, int]
    path: list[tuple[int, int]]
    seconds: float

    @property
    def key(self) -> tuple[str, str]:
        return self.scene, self.episode_id


class Broken(msgspec.Struct, frozen=True, kw_only=True):
    """An episode that the program failed on: never counted, always named, tried again by the next run."""

    scene: str
    episode_id: str
    error: str


class Records:
    """A run's folder. Safe for several processes at once.

    Raises (all methods):
        ConfigError: the file is damaged, of another run, or the disk is full; the message says what to do.
    """

    def __init__(self, folder: Path, settings: RunSettings, basis: Basis) -> None:
        """Settings and basis are kept, so runs can't be mixed; a folder without an episode takes any."""
        self.path = folder / _FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder} can't be made a folder for a run: {error.strerror}") from error
        facts = _facts(settings, basis)
        with _open(self.path, writing=True) as db:
            db.execute("CREATE TABLE IF NOT EXISTS run (facts TEXT NOT NULL)")
            db.execute(f"CREATE TABLE IF NOT EXISTS episodes {_EPISODES}")
            db.execute(f"CREATE TABLE IF NOT EXISTS broken {_BROKEN}")
            row = db.execute("SELECT facts FROM run").fetchone()
            if row is None:
                db.execute("INSERT INTO run VALUES (?)", [json.dumps(facts)])
            elif (there := _read_facts(row[0], self.path)) == facts:
                return
            elif db.execute("SELECT COUNT(*) FROM episodes").fetchone() == (0,):
                db.execute("UPDATE run SET facts = ?", [json.dumps(facts)])
                db.execute("DELETE FROM broken")
            else:
                raise ConfigError(
                    f"{folder} holds another run ({_difference(there, facts)}): take another --out, "
                    "or delete that folder to play it anew"
                )

    def add(self, record: EpisodeRecord) -> None:
        """Keeps an episode; when this returns, a kill can't lose it."""
        with _open(self.path, writing=True) as db:
            db.execute(
                "INSERT OR REPLACE INTO episodes VALUES (?, ?, ?, ?, ?, ?)", [*_columns(record), _packed(record)]
            )
            db.execute("DELETE FROM broken WHERE scene = ? AND episode_id = ?", record.key)

    def add_broken(self, broken: Broken) -> None:
        with _open(self.path, writing=True) as db:
            db.execute(
                "INSERT OR REPLACE INTO broken VALUES (?, ?, ?)", [broken.scene, broken.episode_id, broken.error]
            )

    def mend(self) -> list[tuple[str, str]]:
        """Forgets episodes whose row can't be read or contradicts itself, so that they are played anew; which these were."""
        sound, damaged = [], []
        with _open(self.path, writing=True) as db:
            for row in _rows(db):
                try:
                    _record_of(row)
                    sound.append(row)
                except _UNREADABLE:
                    damaged.append((str(row[0]), str(row[1])))
            if damaged or db.execute("PRAGMA integrity_check(1)").fetchone() != ("ok",):
                # made anew, because a row whose key was damaged is found under neither the old key nor the new one
                for table, columns in (("episodes", _EPISODES), ("broken", _BROKEN)):
                    db.execute(f"DROP TABLE {table}")
                    db.execute(f"CREATE TABLE {table} {columns}")
                db.executemany("INSERT OR REPLACE INTO episodes VALUES (?, ?, ?, ?, ?, ?)", sound)
        return sorted(damaged)

    def done(self) -> set[tuple[str, str]]:
        """The keys of what is there."""
        with _open(self.path) as db:
            return set(db.execute("SELECT scene, episode_id FROM episodes"))

    def all(self) -> list[EpisodeRecord]:
        """All episodes, in the dataset's order."""
        return read(self.path.parent)

    def broken(self) -> list[Broken]:
        return _broken(self.path)


def _facts(settings: RunSettings, basis: Basis) -> dict[str, Any]:
    """What makes a run this run."""
    return {"version": VERSION, **basis._asdict(), "settings": msgspec.to_builtins(settings)}


def _read_facts(text: str, path: Path) -> dict[str, Any]:
    try:
        return msgspec.json.decode(text, type=dict[str, Any])
    except (msgspec.DecodeError, TypeError) as error:
        raise ConfigError(f"{path} doesn't say of which run it is ({error}): {_MOVE_AWAY}") from error


def _broken(path: Path) -> list[Broken]:
    with _open(path) as db:
        rows = db.execute("SELECT scene, episode_id, error FROM broken ORDER BY scene, episode_id").fetchall()
    return [Broken(scene=s, episode_id=e, error=error) for s, e, error in rows]


class Kept(NamedTuple):
    """What a folder holds of a run."""

    records: list[EpisodeRecord]
    broken: list[Broken]


def kept(folder: Path, settings: RunSettings, basis: Basis) -> Kept | None:
    """What was played of this very run, without touching the folder; None: nothing, or it is another run's.

    Raises:
        ConfigError: the file is damaged.
    """
    path = folder / _FILE
    if not path.exists():
        return None
    with _open(path) as db:
        made = db.execute("SELECT COUNT(*) FROM sqlite_master WHERE name = 'run'").fetchone() != (0,)
        row = db.execute("SELECT facts FROM run").fetchone() if made else None
    if row is None or _read_facts(row[0], path) != _facts(settings, basis):
        return None
    return Kept(read(folder), _broken(path))


def read(folder: Path) -> list[EpisodeRecord]:
    """All episodes in a run's folder, whatever program and dataset they were played with, in the dataset's order.

    Raises:
        ConfigError: there is no such file, it is damaged, or of another version.
    """
    path = folder / _FILE
    if not path.exists():
        raise ConfigError(f"{folder} holds no run: expected a file {_FILE}")
    with _open(path) as db:
        facts = db.execute("SELECT facts FROM run").fetchone()
        rows = _rows(db)
    version = _read_facts(facts[0], path).get("version") if facts else VERSION
    if version != VERSION:
        raise ConfigError(f"{path} is of version {version}, expected {VERSION}: read it with the program that wrote it")
    try:
        records = [_record_of(row) for row in rows]
    except _UNREADABLE as error:
        raise ConfigError(
            f"{path} holds a record that can't be read ({error}): a run into this folder plays that episode anew"
        ) from error
    return sorted(records, key=lambda r: (r.scene, int(r.episode_id)))


@contextmanager
def _open(path: Path, *, writing: bool = False) -> Iterator[sqlite3.Connection]:
    """One transaction; of those that write, one at a time."""
    try:
        # Python's own transactions leave out what makes and drops tables
        db = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)
        db.text_factory = lambda text: text.decode(errors="replace")  # what was damaged is told by what it says
        try:
            with db:
                db.execute("BEGIN IMMEDIATE" if writing else "BEGIN")
                yield db
        finally:
            db.close()
    except sqlite3.OperationalError as error:
        raise ConfigError(f"{path} can't be used: {error}; is the disk full or read-only?") from error
    except sqlite3.DatabaseError as error:
        raise ConfigError(f"{path} is damaged: {error}; {_MOVE_AWAY}") from error


def _packed(record: EpisodeRecord) -> bytes:
    """Deflated JSON, of the path its start and the moves: a sixth of the bytes, so that runs can be published whole."""
    moves = [(x - x0, y - y0) for (x0, y0), (x, y) in pairwise([(0, 0), *record.path])]
    return zlib.compress(msgspec.json.encode(msgspec.structs.replace(record, path=moves)), 9)


def _unpacked(blob: bytes) -> EpisodeRecord:
    record = msgspec.json.decode(zlib.decompress(blob), type=EpisodeRecord)
    x, y = (accumulate(values) for values in zip(*record.path, strict=True)) if record.path else ((), ())
    return msgspec.structs.replace(record, path=list(zip(x, y, strict=True)))


def _columns(record: EpisodeRecord) -> tuple[str, str, bool, float, str]:
    """What is kept beside a record, for those who ask the file in SQL."""
    return *record.key, record.success, record.spl, record.reason


def _rows(db: sqlite3.Connection) -> list[tuple[Any, ...]]:
    """Of the episodes, from the table itself: an index may be damaged."""
    return db.execute("SELECT * FROM episodes NOT INDEXED").fetchall()


def _record_of(row: tuple[Any, ...]) -> EpisodeRecord:
    """Raises one of ``_UNREADABLE``: it can't be read, or isn't what is kept beside it."""
    *beside, blob = row
    record = _unpacked(blob)
    if tuple(beside) != _columns(record):
        raise ValueError(f"kept as {beside}, it says {_columns(record)}")
    return record


#: What is raised of bytes that weren't written here; ValueError is also that of msgspec and of UTF-8.
_UNREADABLE = (ValueError, zlib.error, TypeError)

_MOVE_AWAY = "move it away and run again: the episodes are then played anew"


def _difference(kept: dict[str, Any], asked: dict[str, Any]) -> str:
    """What a person would want to know of two runs' facts."""
    if kept.get("version") != asked["version"]:
        return f"its records are of version {kept.get('version')}"
    if kept.get("dataset") != asked["dataset"]:
        return "on another dataset"
    if kept.get("program") != asked["program"]:
        return "by another version of the program"
    was, now = kept.get("settings"), asked["settings"]
    if not isinstance(was, dict):
        return "of which the settings aren't said"
    return ", ".join(f"{k} {was.get(k)!r}, asked {v!r}" for k, v in now.items() if was.get(k) != v)
