"""What the planner's core is given, what it remembers, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.messages import Candidate, ObjectRecord, RobotStatus, Stair

Phase = Literal["scanning", "exploring", "approaching", "confirming", "changing floor", "second look", "finished"]
WaypointKind = Literal["target", "candidate", "frontier", "stairs", "second_look"]


@dataclass(frozen=True, slots=True, eq=False)
class MapView:
    """The joint maps of one floor at one revision.

    Attributes:
        floor: the floor's id; ``floor_z_m``: its altitude [m].
        grid: frame of all layers; each layer is (rows, cols).
        occupancy, explored, frontier: uint8, 0 or 1.
        value: float32, NaN where unknown: relevance to the mission's target.
        objects: the objects of the floor.
        revision: counts the maps' states.
        pending_views: views of this floor's cameras that are still to come.
    """

    floor: str
    floor_z_m: float
    grid: Grid
    occupancy: NDArray[np.uint8]
    explored: NDArray[np.uint8]
    frontier: NDArray[np.uint8]
    value: NDArray[np.float32]
    objects: Sequence[ObjectRecord]
    revision: int
    pending_views: int = 0


@dataclass(frozen=True, slots=True)
class RobotView:
    """The robot at observation ``seq``: (x, y) [m, world], yaw and camera pitch (> 0 looks up) [rad].

    ``stairs``: all stairs (or lifts) of the building that it can take, in both directions.
    """

    seq: int
    x_m: float
    y_m: float
    yaw_rad: float
    pitch_rad: float
    floor: str
    collided: bool
    last_action: str | None
    path_m: float
    stairs: tuple[Stair, ...] = ()

    @classmethod
    def from_status(cls, status: RobotStatus, mission: str, stairs: tuple[Stair, ...]) -> RobotView:
        """The robot by its own word. What it did in another mission says nothing in this one."""
        x_m, y_m, _ = status.T_world_base.translation_m
        T_world_base, ours = status.T_world_base.matrix(), status.mission == mission
        return cls(
            status.seq,
            x_m,
            y_m,
            math.atan2(T_world_base[1, 0], T_world_base[0, 0]),
            status.pitch_rad,
            status.floor,
            collided=ours and status.collided,
            last_action=status.last_action if ours else None,
            path_m=status.path_m if ours else 0.0,
            stairs=stairs,
        )


@dataclass(frozen=True, slots=True)
class CurrentWaypoint:
    """The waypoint that the robot is on its way to, and how that goes.

    ``best_m`` is the shortest remaining way so far (None: not yet known), reached at ``best_step``: no progress for
    long ends it. ``detours``: how often it turned out to be longer. ``unpromising``: it was chosen although hardly anything
    speaks for it.
    """

    kind: WaypointKind
    x_m: float
    y_m: float
    best_m: float | None
    best_step: int
    object_id: int | None = None
    unpromising: bool = False
    detours: int = 0


@dataclass(frozen=True, slots=True)
class BlacklistEntry:
    """A place that was tried in vain: left alone until ``until_step``; after ``times`` = 2 for good (a confirmed target: 4)."""

    x_m: float
    y_m: float
    times: int
    until_step: int


@dataclass(frozen=True, slots=True)
class FloorGoal:
    """The floor that the robot is on its way to, why, and its chance per metre of finding the target."""

    to_floor: str
    why: str
    worth: float = 0.0


@dataclass(frozen=True, slots=True)
class FloorChange:
    """A stair that was taken: at which mission step, from where to where, and why."""

    step: int
    floor: str
    to_floor: str
    why: str


@dataclass(slots=True)
class FloorMemory:
    """What a mission remembers of one floor: places, and objects by their id on that floor.

    Attributes:
        scan_left: turns left of the first look around; None before it is decided whether there is one.
        visited: where the robot stood [m, world]. ``collisions``: where its centre can't go;
            ``bumps``: (x, y, yaw) of the headings that ended there.
        blacklist: frontiers and objects given up for a while or for good. ``put_off``: frontiers left for the end, because
            only tight gaps lead there. ``dropped``: objects found not to be the target, by id: (x, y, why).
        inspected: turns spent on looking at an object within ``inspect_m``; ``looks``: extra looks spent, by object.
        wavered: how often an object ceased to be promising while the robot was on its way to it.
        accepted_object: the object to be accepted on weaker evidence because nothing else is left.
        scans: where the robot looked all around.
        stairs_failed: how often a stair of this floor couldn't be reached or taken, by its name.
        visits: how often the robot came here. ``exhausted``: nothing was left to explore or to look at.
        reserve: chance of the likeliest object here that could still be accepted as a last resort; 0: none.
    """

    scan_left: int | None = None
    visited: list[tuple[float, float]] = field(default_factory=list)
    collisions: list[tuple[float, float]] = field(default_factory=list)
    bumps: list[tuple[float, float, float]] = field(default_factory=list)
    blacklist: list[BlacklistEntry] = field(default_factory=list)
    put_off: list[tuple[float, float]] = field(default_factory=list)
    dropped: dict[int, tuple[float, float, str]] = field(default_factory=dict)
    inspected: dict[int, int] = field(default_factory=dict)
    looks: dict[int, int] = field(default_factory=dict)
    wavered: dict[int, int] = field(default_factory=dict)
    accepted_object: int | None = None
    scans: list[tuple[float, float]] = field(default_factory=list)
    stairs_failed: dict[str, int] = field(default_factory=dict)
    visits: int = 0
    exhausted: bool = False
    reserve: float = 0.0

    def copy(self) -> FloorMemory:
        """A copy whose containers are its own."""
        return replace(
            self,
            visited=list(self.visited),
            collisions=list(self.collisions),
            bumps=list(self.bumps),
            blacklist=list(self.blacklist),
            put_off=list(self.put_off),
            dropped=dict(self.dropped),
            inspected=dict(self.inspected),
            looks=dict(self.looks),
            wavered=dict(self.wavered),
            scans=list(self.scans),
            stairs_failed=dict(self.stairs_failed),
        )


@dataclass(slots=True)
class MissionState:
    """What the planner remembers of a mission. ``step`` works on a copy and never changes its argument; of all functions only
    those of ``memory`` write to it.

    Plain values only: ``to_json`` and ``from_json`` give an equal state, and a mission resumed from it decides as
    one that was never interrupted.

    Attributes:
        step: actions decided so far; a stair counts as many as moves of its length.
        floor: where the robot was at the last step, "" before the first; ``floors``: what is known of each.
        anchor: (x, y, step) where the robot was when it last moved on; ``escapes`` since then.
        waypoint: where the robot is on its way to.
        peeks: turns spent at the present frontier. ``second_look_left``: turns left of a second look around.
        floor_goal: the floor that the robot is on its way to. ``taking``: the stair's end (x, y) [m] that it was told to
            take, and the steps that this counts.
        changes: all stairs taken.
        unreachable: why a confirmed target couldn't be reached (for the final word); empty: none was.
    """

    target: str
    max_steps: int = 500
    step: int = 0
    floor: str = ""
    floors: dict[str, FloorMemory] = field(default_factory=dict)
    waypoint: CurrentWaypoint | None = None
    anchor: tuple[float, float, int] | None = None
    escapes: int = 0
    peeks: int = 0
    second_look_left: int = 0
    floor_goal: FloorGoal | None = None
    taking: tuple[float, float, int] | None = None
    changes: list[FloorChange] = field(default_factory=list)
    unreachable: str = ""
    finished: bool = False

    def __post_init__(self) -> None:
        self.floors.setdefault(self.floor, FloorMemory())

    @property
    def here(self) -> FloorMemory:
        """The memory of the floor that the robot is on."""
        return self.floors[self.floor]

    def copy(self) -> MissionState:
        """A copy whose containers are its own."""
        floors = {name: memory.copy() for name, memory in self.floors.items()}
        return replace(self, floors=floors, changes=list(self.changes))

    def to_json(self) -> bytes:
        """The state as JSON."""
        return msgspec.json.encode(self)

    @classmethod
    def from_json(cls, data: bytes) -> MissionState:
        """The state that ``to_json`` wrote. msgspec.DecodeError: it isn't one."""
        return msgspec.json.decode(data, type=cls)


@dataclass(frozen=True, slots=True)
class Decision:
    """The next action and why.

    Attributes:
        action: one of ``surveilnav.messages.ACTIONS``; None when the mission failed.
        to_floor: belongs to ``take_stairs``.
        waypoint: the one chosen, None: none was; ``path``: (x, y) [m, world] from the robot to it; ``distance_m`` its length.
        candidates: what else was weighed.
        phase: what the robot is doing.
        finished, found: the mission's end; ``found`` comes with the action ``stop``.
        error: the failure's name, empty if none. ``message``: for people.
    """

    action: str | None
    phase: Phase
    message: str = ""
    to_floor: str | None = None
    waypoint: Candidate | None = None
    path: tuple[tuple[float, float], ...] = ()
    distance_m: float | None = None
    candidates: tuple[Candidate, ...] = ()
    finished: bool = False
    found: bool = False
    error: str = ""
    object_id: int | None = None
