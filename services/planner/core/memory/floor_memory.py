"""What a mission remembers of one floor: where the robot was and looked, and which places and objects it is done with."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from surveilnav.services.planner.core.memory.blacklist import Blacklist


@dataclass(frozen=True, slots=True)
class DismissedObject:
    """An object that the robot looked at and found not to be the target: its place (x, y) [m] at that time, and why."""

    x_m: float
    y_m: float
    why: str


@dataclass(slots=True)
class FloorMemory:
    """What a mission remembers of one floor. Objects are named by their id on that floor, places by (x, y) [m, world].

    Attributes:
        scan_turns_left: turns left of the initial scan; None until it is decided whether there is one.
        visited: where the robot stood, in order.
        collisions: places where its centre can't be, because it bumped into something.
        bumps: (x, y, yaw [rad]): from there a move in this heading was cut short.
        blacklist: frontiers and objects that the robot failed to reach.
        deferred_frontiers: frontiers left for the end, because only narrow gaps lead there.
        dismissed: objects that the robot found not to be the target.
        inspection_turns: turns spent on facing an object near by while driving, by object.
        extra_looks: additional looks spent at an object from its goal region, by object.
        looked_from: places from which the robot looked at an object without being sure of it, by object.
        oscillations: how often an object ceased to be promising while the robot was heading for it, by object.
        accepted_object: the object taken for the target on weaker evidence, because nothing else is left.
        scan_places: where the robot looked all around, or would have if it could get there.
        stairs_failures: how often stairs of this floor couldn't be reached or taken, by ``stairs_name``.
        visits: how often the robot came to this floor.
        is_searched: nothing was left to explore or to look at.
        best_remaining_chance: once it is searched, the chance of the likeliest object that could still be accepted as a
            last resort; 0: there is none.
    """

    scan_turns_left: int | None = None
    visited: list[tuple[float, float]] = field(default_factory=list)
    collisions: list[tuple[float, float]] = field(default_factory=list)
    bumps: list[tuple[float, float, float]] = field(default_factory=list)
    blacklist: Blacklist = field(default_factory=Blacklist)
    deferred_frontiers: list[tuple[float, float]] = field(default_factory=list)
    dismissed: dict[int, DismissedObject] = field(default_factory=dict)
    inspection_turns: dict[int, int] = field(default_factory=dict)
    extra_looks: dict[int, int] = field(default_factory=dict)
    looked_from: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    oscillations: dict[int, int] = field(default_factory=dict)
    accepted_object: int | None = None
    scan_places: list[tuple[float, float]] = field(default_factory=list)
    stairs_failures: dict[str, int] = field(default_factory=dict)
    visits: int = 0
    is_searched: bool = False
    best_remaining_chance: float = 0.0

    def stairs_failures_at(self, x_m: float, y_m: float) -> int:
        """How often the stairs that end here couldn't be reached or taken."""
        return self.stairs_failures.get(stairs_name(x_m, y_m), 0)

    def begin_scan(self, x_m: float, y_m: float, turns: int) -> None:
        """Begins the initial scan of ``turns`` turns at the robot's place."""
        self.scan_turns_left = turns
        self.record_scan_place(x_m, y_m)

    def skip_scan(self) -> None:
        """Decides that this floor gets no initial scan, or no more of it."""
        self.scan_turns_left = 0

    def record_scan_place(self, x_m: float, y_m: float) -> None:
        """Records a place where the robot looks all around, or that it can't reach to do so."""
        self.scan_places.append((x_m, y_m))

    def record_bump(self, x_m: float, y_m: float, yaw_rad: float, obstacle: tuple[float, float]) -> None:
        """Records that a move from (x, y) was cut short by an obstacle, at which the robot's centre can't be."""
        self.collisions.append(obstacle)
        self.bumps.append((x_m, y_m, yaw_rad))

    def forget_collisions(self) -> None:
        self.collisions.clear()
        self.bumps.clear()

    def defer_frontier(self, x_m: float, y_m: float) -> None:
        """Leaves a frontier for the end, because only narrow gaps lead there."""
        self.deferred_frontiers.append((x_m, y_m))

    def record_inspection(self, object_id: int, turns: int) -> None:
        """Records how many turns were spent so far on facing an object near by while driving."""
        self.inspection_turns[object_id] = turns

    def record_extra_look(self, object_id: int) -> None:
        """Records one more look at an object from its goal region."""
        self.extra_looks[object_id] = self.extra_looks.get(object_id, 0) + 1

    def record_looked_from(self, object_id: int, x_m: float, y_m: float) -> None:
        """Records that an object wasn't verified from a place. From elsewhere, it gets as many looks again."""
        self.looked_from.setdefault(object_id, []).append((x_m, y_m))
        self.extra_looks.pop(object_id, None)

    def record_searched(self, best_remaining_chance: float) -> None:
        """Records that nothing is left to explore or to look at on this floor."""
        self.is_searched = True
        self.best_remaining_chance = best_remaining_chance

    def forget_objects(self) -> None:
        """Forgets what it remembers of objects by their ids, which mean other objects now. Dismissed places stay dismissed."""
        self.dismissed = {
            -k: dismissed for k, dismissed in enumerate(self.dismissed.values(), 1)
        }  # no object has these ids
        for by_object in (self.inspection_turns, self.extra_looks, self.oscillations, self.looked_from):
            by_object.clear()
        self.accepted_object = None
        self.is_searched, self.best_remaining_chance = False, 0.0

    def copy(self) -> FloorMemory:
        """A copy whose containers are its own."""
        return replace(
            self,
            visited=list(self.visited),
            collisions=list(self.collisions),
            bumps=list(self.bumps),
            blacklist=self.blacklist.copy(),
            deferred_frontiers=list(self.deferred_frontiers),
            dismissed=dict(self.dismissed),
            inspection_turns=dict(self.inspection_turns),
            extra_looks=dict(self.extra_looks),
            looked_from={k: list(places) for k, places in self.looked_from.items()},
            oscillations=dict(self.oscillations),
            scan_places=list(self.scan_places),
            stairs_failures=dict(self.stairs_failures),
        )


def stairs_name(x_m: float, y_m: float) -> str:
    """What stairs of a floor are called: the place of their end on that floor."""
    return f"({x_m:.1f}, {y_m:.1f})"
