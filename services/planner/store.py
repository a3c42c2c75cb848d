"""The planner's missions on disk, so that they survive a restart: one SQLite file with a row for each mission.

A goal is written before it is acknowledged, and a decision before its action is sent. What is written survives ``kill -9`` of
the planner. Goals and the ends of missions are synced to the disk, so they also survive a power cut.
"""

from __future__ import annotations

import sqlite3
import threading
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from surveilnav.bus import Node
from surveilnav.errors import SurveilNavError
from surveilnav.messages import MissionStatus, Plan, WaypointPose
from surveilnav.services.planner.core import Decision

#: Version of the tables and of what is in them. A store of any other version than these two is set aside, not read.
VERSION = 3
#: The version of release 0.1.0: the same but for what the core remembers of a mission, which is dropped.
_VERSION_0_1_0 = 2
_SCHEMA = """CREATE TABLE IF NOT EXISTS missions (
    id TEXT PRIMARY KEY, finished INTEGER NOT NULL, record TEXT NOT NULL, memory TEXT NOT NULL)"""
_SAVE = """INSERT INTO missions (id, finished, record, memory) VALUES (?, ?, ?, ?)
    ON CONFLICT (id) DO UPDATE SET finished = excluded.finished, record = excluded.record, memory = excluded.memory"""


class StoreError(SurveilNavError):
    """The store can't be read or written now. The message has its path and SQLite's error."""


class PendingAction(msgspec.Struct, frozen=True, kw_only=True):
    """The decision made on observation ``seq``. The robot may or may not have carried it out yet.

    Sending it again does no harm, because the robot carries out only one action for each sequence number.
    """

    seq: int
    action: str | None
    to_floor: str | None = None
    finished: bool = False
    found: bool = False
    error: str = ""
    message: str = ""
    waypoint: WaypointPose | None = None

    @classmethod
    def from_decision(cls, decision: Decision, seq: int) -> PendingAction:
        return cls(
            seq=seq,
            action=decision.action,
            to_floor=decision.to_floor,
            finished=decision.finished,
            found=decision.found,
            error=decision.error,
            message=decision.message,
            waypoint=decision.waypoint_pose,
        )


class PassageWait(msgspec.Struct, frozen=True, kw_only=True):
    """A pause that ends by itself, once one of these passages of a floor isn't closed any more. ``reason`` is for people."""

    reason: str
    floor: str
    passages: tuple[str, ...]


class SavedMission(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a mission needs to continue after a restart. A field added to it needs a default: older stores lack it.

    Attributes:
        status, plan: the newest of their kind.
        pending: the action that was decided last.
        robot_path_m: the part of ``status.path_m`` that the robot itself reported at the last decision.
        cancel: the reason, once it was cancelled.
        paused: the reason, while it is paused until a person resumes it.
        waits_for: the passages for which it is paused; None: for none.
        vouched: closed passages that a person said can be passed, as (floor, passage).
        frame_problem_reported: whether it was paused because its robot can't be where it says, and that is still so.
        wanted_robot: the robot that the goal asked for; "": any.
        memory: the core's ``MissionState`` as JSON; "": there is none yet, or the mission has ended.
    """

    status: MissionStatus
    plan: Plan | None = None
    pending: PendingAction | None = None
    robot_path_m: float = 0.0
    cancel: str | None = None
    paused: str | None = None
    waits_for: PassageWait | None = None
    vouched: frozenset[tuple[str, str]] = frozenset()
    frame_problem_reported: bool = False
    wanted_robot: str = ""
    memory: str = ""


class Store:
    """The missions in the file ``path``; with an empty path nothing is stored. Safe to use from any thread.

    A file that is damaged or of another version is moved aside under another name, which is logged, and a new one begins. Where
    the file can't be read or written, every call tries again and raises ``StoreError``: the disk may have room by then.
    ``problem`` is why the last call failed; "" if it didn't.

    The column ``record`` holds a SavedMission without its memory, which has a column of its own.
    """

    def __init__(self, path: str, node: Node) -> None:
        self._path, self._log = Path(path) if path else None, node.log
        self._lock = threading.Lock()
        self._open: sqlite3.Connection | None = None
        self.problem = ""

    def retry(self) -> None:
        """Finds out whether the file can be written again, if the last call has failed."""
        if self.problem:
            with self._lock, suppress(StoreError):
                self._execute(f"PRAGMA user_version = {VERSION}")

    def load(self) -> list[SavedMission]:
        """All missions, in the order in which they were accepted. Raises StoreError."""
        with self._lock:
            rows = self._execute("SELECT id, record, memory FROM missions ORDER BY rowid")
        missions = []
        for id, record, memory in rows:
            try:
                mission = msgspec.json.decode(record, type=SavedMission)
            except msgspec.MsgspecError as error:
                self._log.error("store_unreadable: a mission can't be resumed", mission=id, error=str(error))
                continue
            missions.append(msgspec.structs.replace(mission, memory=memory))
        return missions

    def save(self, mission: SavedMission, *, finished: bool = False, sync: bool = False) -> None:
        """Writes a mission. ``sync``: waits until it is on the disk, so that it survives a power cut. Raises StoreError."""
        record = msgspec.json.encode(msgspec.structs.replace(mission, memory="")).decode()
        with self._lock:
            self._execute(f"PRAGMA synchronous = {'FULL' if sync else 'NORMAL'}")
            self._execute(_SAVE, (mission.status.mission, finished, record, mission.memory))

    def delete(self, ids: list[str]) -> None:
        """Deletes missions. Raises StoreError."""
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
            rows = self._connection(self._path).execute(sql, values).fetchall()
        except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
            self._close()  # the next call tries again from the start
            self.problem = (
                f"the store of missions {self._path} can't be used: {error}. Make room or mend it, or set "
                "SURVEILNAV_PLANNER__STORE to another path (empty: missions don't outlive the planner)"
            )
            raise StoreError(self.problem) from error
        self.problem = ""
        return rows

    def _connection(self, path: Path) -> sqlite3.Connection:
        if self._open is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            fault = _fault_of(path)
            if fault:
                self._set_aside(path, fault)
            self._open = _connect(path)
            self._open.execute(_SCHEMA)
            if _version_of(self._open) == _VERSION_0_1_0:
                self._upgrade(self._open)
            self._open.execute(f"PRAGMA user_version = {VERSION}")
        return self._open

    def _upgrade(self, connection: sqlite3.Connection) -> None:
        """Makes a store of release 0.1.0 one of this version. Open missions search anew, and keep their count of steps."""
        connection.execute("UPDATE missions SET memory = ''")
        self._log.warning("store_upgraded: open missions search anew", store=str(self._path), version=_VERSION_0_1_0)

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


def _version_of(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _fault_of(path: Path) -> str:
    """Why a store can't be read; empty if it can, or if there is none yet.

    Raises:
        sqlite3.OperationalError: the file can't be accessed: it is locked, there is no permission, or the disk is full.
    """
    if not path.exists() or path.stat().st_size == 0:
        return ""
    try:
        connection = _connect(path)
        try:
            version = _version_of(connection)
            sound = connection.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok"
        finally:
            connection.close()
    except sqlite3.OperationalError:
        raise
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # Unicode: damaged bytes within SQLite's own message
        return f"store_corrupt ({error})"
    if not sound:
        return "store_corrupt (its integrity check failed)"
    return "" if version in (VERSION, _VERSION_0_1_0) else f"store_version (expected {VERSION}, got {version})"
