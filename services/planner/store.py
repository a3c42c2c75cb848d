"""The planner's missions on disk, so that they outlive it: one SQLite file, a row a mission.

A goal is written before it is acknowledged, and what a mission decided before the action is sent. What is written
survives ``kill -9`` of the planner; goals and ends, which are synced, survive a power cut too.
"""

from __future__ import annotations

import sqlite3
import threading
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from surveilnav.bus import Node
from surveilnav.errors import SurveilNavError
from surveilnav.messages import MissionStatus, Plan
from surveilnav.services.planner.core import Decision

#: Of the tables and of what is in them. Records of version 1 lack ``robot_path_m`` and have two fields more, which reading
#: passes over. A store of any other version is set aside, not read.
VERSION = 2
_READABLE = (1, VERSION)
_SCHEMA = """CREATE TABLE IF NOT EXISTS missions (
    id TEXT PRIMARY KEY, finished INTEGER NOT NULL, record TEXT NOT NULL, memory TEXT NOT NULL)"""
_SAVE = """INSERT INTO missions (id, finished, record, memory) VALUES (?, ?, ?, ?)
    ON CONFLICT (id) DO UPDATE SET finished = excluded.finished, record = excluded.record, memory = excluded.memory"""


class StoreError(SurveilNavError):
    """The store can't be written or read now; the message says where it is and what SQLite said."""


class Pending(msgspec.Struct, frozen=True, kw_only=True):
    """An action that was decided after observation ``seq``, whether or not the robot has carried it out.

    It may be sent again as often as one likes: the robot carries out one action a sequence number.
    """

    seq: int
    action: str | None
    to_floor: str | None = None
    finished: bool = False
    found: bool = False
    error: str = ""
    message: str = ""

    @classmethod
    def of(cls, decision: Decision, seq: int) -> Pending:
        return cls(
            seq=seq,
            action=decision.action,
            to_floor=decision.to_floor,
            finished=decision.finished,
            found=decision.found,
            error=decision.error,
            message=decision.message,
        )


class SavedMission(msgspec.Struct, frozen=True, kw_only=True):
    """A mission as it goes on after a restart.

    ``robot_path_m``: of ``status.path_m`` what the robot itself spoke of at the last decision; ``cancel``: the reason, once
    somebody cancelled it; ``paused``: the same while it is paused; ``wanted_robot``: the one that it asked for, "": any;
    ``memory``: the core's, as JSON ("": none yet, or the mission is over).
    """

    status: MissionStatus
    plan: Plan | None = None
    pending: Pending | None = None
    robot_path_m: float = 0.0
    cancel: str | None = None
    paused: str | None = None
    wanted_robot: str = ""
    memory: str = ""


class _Record(msgspec.Struct, frozen=True, kw_only=True):
    """The column ``record``: a SavedMission but for its memory."""

    status: MissionStatus
    plan: Plan | None
    pending: Pending | None
    cancel: str | None
    robot_path_m: float | None = None
    paused: str | None = None
    wanted_robot: str = ""


class Store:
    """The missions in the file ``path``; with an empty path nothing is kept. Safe to use from any thread.

    A file that can't be read (damaged, of another version) is set aside under another name, with a word in the log, and
    a new one begun. Where nothing can be written ``StoreError`` is raised, each time anew: a disk may have room again.
    """

    def __init__(self, path: str, node: Node) -> None:
        self._path, self._log = Path(path) if path else None, node.log
        self._lock = threading.Lock()
        self._open: sqlite3.Connection | None = None

    def load(self) -> list[SavedMission]:
        """All missions, in the order in which they were accepted. Raises StoreError."""
        with self._lock:
            rows = self._execute("SELECT id, record, memory FROM missions ORDER BY rowid")
        missions = []
        for id, record, memory in rows:
            try:
                r = msgspec.json.decode(record, type=_Record)
            except msgspec.MsgspecError as error:
                self._log.error("store_unreadable: a mission can't be resumed", mission=id, error=str(error))
                continue
            facts = msgspec.structs.asdict(r)
            if r.robot_path_m is None:  # of version 1
                facts["robot_path_m"] = r.status.path_m
            missions.append(SavedMission(**facts, memory=memory))
        return missions

    def save(self, mission: SavedMission, *, finished: bool = False, sync: bool = False) -> None:
        """Writes a mission; ``sync``: down to the disk. Raises StoreError."""
        facts = msgspec.structs.asdict(mission)
        memory = facts.pop("memory")
        record = msgspec.json.encode(_Record(**facts)).decode()
        with self._lock:
            self._execute(f"PRAGMA synchronous = {'FULL' if sync else 'NORMAL'}")
            self._execute(_SAVE, (mission.status.mission, finished, record, memory))

    def forget(self, ids: list[str]) -> None:
        """Removes missions. Raises StoreError."""
        with self._lock:
            for id in ids:
                self._execute("DELETE FROM missions WHERE id = ?", (id,))

    def close(self) -> None:
        with self._lock:
            self._close()

    # --- the file -------------------------------------------------------------------------------------------------

    def _execute(self, sql: str, values: tuple[object, ...] = ()) -> list[tuple[str, str, str]]:
        if self._path is None:
            return []
        try:
            return self._connection(self._path).execute(sql, values).fetchall()
        except (sqlite3.Error, OSError) as error:
            self._close()  # the next call tries again from the start
            raise StoreError(
                f"the store of missions {self._path} can't be used: {error}. Make room or mend it, or set "
                "SURVEILNAV_PLANNER__STORE to another path (empty: missions don't outlive the planner)"
            ) from error

    def _connection(self, path: Path) -> sqlite3.Connection:
        if self._open is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            fault = _fault_of(path)
            if fault:
                self._set_aside(path, fault)
            self._open = _connect(path)
            self._open.execute(_SCHEMA)
            self._open.execute(f"PRAGMA user_version = {VERSION}")
        return self._open

    def _set_aside(self, path: Path, fault: str) -> None:
        stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S-%f")
        aside = path.with_name(f"{path.name}.{stamp}")
        for suffix in ("", "-wal", "-shm"):
            part = path.with_name(path.name + suffix)
            if part.exists():
                part.rename(aside.with_name(aside.name + suffix))
        self._log.error(f"{fault}: set aside, and a new store begun", store=str(path), aside=str(aside))

    def _close(self) -> None:
        if self._open is not None:
            self._open.close()
            self._open = None


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=5.0, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA journal_mode = WAL")
    return connection


def _fault_of(path: Path) -> str:
    """Why a store can't be read, by name; empty if it can, or if there is none yet.

    Raises:
        sqlite3.OperationalError: it can't be got at: locked, no permission, the disk is full.
    """
    if not path.exists() or path.stat().st_size == 0:
        return ""
    try:
        connection = _connect(path)
        try:
            version = connection.execute("PRAGMA user_version").fetchone()[0]
            sound = connection.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok"
        finally:
            connection.close()
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError as error:
        return f"store_corrupt ({error})"
    if not sound:
        return "store_corrupt (its pages don't fit together)"
    return "" if version in _READABLE else f"store_version (expected {VERSION}, got {version})"
