"""Where a search may start, where it should end, and whether it succeeded, by the rules of Habitat's ObjectNav.

A search succeeds if the robot called stop within 0.1 m of way of a viewpoint (``viewpoints``) of any object of the
target's class. (habitat-lab ``tasks/nav/nav.py`` and ``object_nav_generator.py``.)

This is the simulator's own truth: no robot, map or planner may use it.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from surveilnav.errors import TargetError
from surveilnav.nouns import thing_asked_for
from surveilnav.simulator.world.distance_field import DistanceField
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.labels import PARTS
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Instance, Scene
from surveilnav.simulator.world.viewpoints import (
    VIEWPOINT_REACH_M,
    eyes_over,
    is_reachable,
    surface_of,
    viewpoints_of,
    visible_share,
)
from surveilnav.words import canonical

SUCCESS_M = 0.1
_MAX_START_CANDIDATES = 2000

#: Rules for drawing a start, tried in this order until a place satisfies one: (note, minimum path as a share of
#: ``min_path_m``, whether the way must be a detour, whether the target must be out of sight).
_RELAXATIONS: tuple[tuple[str, float, bool, bool], ...] = (
    ("", 1.0, True, True),
    ("the way may be straight", 1.0, False, True),
    ("a shorter way, hidden", 0.8, False, True),
    ("a shorter way, hidden", 0.6, False, True),
    ("a shorter way, hidden", 0.4, False, True),
    ("the target may be in sight", 1.0, False, False),
    ("a shorter way, and the target may be in sight", 0.6, False, False),
    ("a shorter way, and the target may be in sight", 0.2, False, False),
    ("next to the target", 0.0, False, False),
)
MIN_DETOUR = 1.05


class StateLike(Protocol):
    """What the judge reads of a robot: see ``surveilnav.robot_state.RobotState``."""

    @property
    def p_world(self) -> tuple[float, float, float]: ...
    @property
    def floor(self) -> str: ...
    @property
    def path_m(self) -> float: ...
    @property
    def stopped(self) -> bool: ...


@dataclass(frozen=True, slots=True, eq=False)
class Goals:
    """All objects of a class that a robot can get to.

    Attributes:
        instances: those with a viewpoint; ``unreachable`` those without.
        viewpoints: by floor, (n, 2) float64 x, y [m]: centres of navigable cells. ``viewpoints_of``: the same by
            instance.
        surface: (m, 3) float32 points on all instances, the unreachable ones too [m, world].
        field: distance to the nearest viewpoint from everywhere.
    """

    label: str
    instances: tuple[Instance, ...]
    unreachable: tuple[Instance, ...]
    viewpoints: dict[str, NDArray[np.float64]]
    viewpoints_of: dict[int, NDArray[np.float64]]
    surface: NDArray[np.float32]
    field: DistanceField


@dataclass(frozen=True, slots=True)
class Start:
    """Where a search begins. ``notes``: which rules a small home made us relax; empty if all hold."""

    p_m: tuple[float, float, float]
    floor: str
    yaw_rad: float
    shortest_path_m: float
    notes: tuple[str, ...] = ()

    def setting(self) -> str:
        """The place as a simulated robot's setting ``start`` has it, to the last digit: x,y,floor,yaw_deg."""
        return f"{self.p_m[0]!r},{self.p_m[1]!r},{self.floor},{math.degrees(self.yaw_rad)!r}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The simulator's check. ``success``: stop called within 0.1 m; the laxer rules are for comparison.

    SPL (Anderson et al. 2018) = success * l / max(l, p); soft SPL puts max(0, 1 - d / l) in the place of success;
    l: shortest path, p: the path walked, d: distance left.
    """

    success: bool
    success_at_0_2_m: bool
    success_at_1_m: bool
    distance_to_viewpoint_m: float
    spl: float
    soft_spl: float
    path_m: float
    shortest_path_m: float


def find_goals(scene: Scene, navigation: NavigationMap, label: str, *, caster: RayCaster | None = None) -> Goals:
    """The goals of a search for ``label`` (any spelling that ``words.canonical`` folds, else any language's).

    Raises:
        TargetError: there is no such thing, or none that a robot can get to; the message lists what it can get to.
    """
    caster = caster or RayCaster(scene)
    wanted = canonical(label)
    wanted = wanted if wanted in PARTS or scene.called(wanted) else thing_asked_for(label)
    instances = scene.called(wanted) if wanted not in PARTS else ()
    if not instances:
        raise TargetError(
            f"there is no {label!r} in {scene.name}; robots can get to {_choice(scene, navigation, caster)}"
        )
    surfaces = [surface_of(scene, instance) for instance in instances]
    seen_from = {
        instance: cells
        for instance, surface in zip(instances, surfaces, strict=True)
        if (cells := viewpoints_of(navigation, instance, surface, caster)) is not None
    }
    if not seen_from:
        raise TargetError(
            f"{scene.name} has {len(instances)} x {wanted!r}, but robots can't get within {VIEWPOINT_REACH_M:g} m and "
            f"sight of any; choose another target: {_choice(scene, navigation, caster)}"
        )
    on_floor: dict[str, NDArray[np.bool_]] = {}
    for instance, cells in seen_from.items():
        on_floor[instance.floor] = on_floor.get(instance.floor, False) | cells
    points = {name: navigation.floors[name].grid.centres_of(np.argwhere(cells)) for name, cells in on_floor.items()}
    points_of = {i.id: navigation.floors[i.floor].grid.centres_of(np.argwhere(cells)) for i, cells in seen_from.items()}
    return Goals(
        wanted,
        tuple(seen_from),
        tuple(i for i in instances if i not in seen_from),
        points,
        points_of,
        np.concatenate(surfaces),
        navigation.distance_field(points),
    )


def within_reach(
    scene: Scene, navigation: NavigationMap, words: Mapping[int, str], caster: RayCaster
) -> dict[str, tuple[int, int]]:
    """By word, in alphabetical order: how many of the things of that name robots can get to, and how many there are.

    ``words``: by instance id, as ``Scene.truth_labels`` or ``labels_by_id``. Parts of the building don't count.
    """
    found: dict[str, tuple[int, int]] = {}
    for instance in scene.instances:
        word = words.get(instance.id, "")
        if word and word not in PARTS:
            near, of = found.get(word, (0, 0))
            found[word] = near + is_reachable(scene, navigation, instance, caster), of + 1
    return dict(sorted(found.items()))


def _choice(scene: Scene, navigation: NavigationMap, caster: RayCaster) -> str:
    """What can be searched for, for people."""
    found = within_reach(scene, navigation, scene.truth_labels, caster)
    return ", ".join(f"{word} ({near})" for word, (near, _) in found.items() if near) or "nothing with a name"


def sample_start(
    scene: Scene,
    navigation: NavigationMap,
    goals: Goals,
    *,
    seed: int,
    min_path_m: float = 5.0,
    max_path_m: float = 30.0,
    caster: RayCaster | None = None,
) -> Start:
    """Where a robot begins to search, drawn by ``seed``: on a floor with a goal, indoors in the robots' connected
    area, at least ``min_path_m`` of way from the nearest viewpoint, that way at least 1.05 times the straight line, no
    object of the class in sight in any direction, any yaw.

    Where the home is too small for that the rules are relaxed in the order of ``_RELAXATIONS``, and the start says so.

    Raises:
        TargetError: there is no place at all to start from.
    """
    caster = caster or RayCaster(scene)
    rng = np.random.default_rng([seed, zlib.crc32(goals.label.encode())])
    candidates = _candidates(navigation, goals, max_path_m, rng)
    hidden: dict[int, bool] = {}
    for note, share, detour, unseen in _RELAXATIONS:
        for index, (floor, cell, path_m, straight_m) in enumerate(candidates):
            if path_m < share * min_path_m or (detour and path_m < MIN_DETOUR * straight_m):
                continue
            if unseen:
                if index not in hidden:
                    hidden[index] = _out_of_sight(navigation.floors[floor], cell, goals, caster)
                if not hidden[index]:
                    continue
            notes = (f"{note}: {path_m:.1f} m",) if note else ()
            return _start_at(navigation.floors[floor], cell, goals, rng, notes)
    raise TargetError(f"there is no place in {scene.name} from which a robot could start to search for {goals.label!r}")


def habitat_starts(
    navigation: NavigationMap, goals: Goals, *, count: int, seed: int, min_path_m: float = 0.2, max_path_m: float = 30.0
) -> list[Start]:
    """Up to ``count`` starts by the rules of Habitat's ObjectNav generator, drawn by ``seed``: in the robots' connected
    area of a floor with a goal, a way of 0.2 to 30 m to the nearest viewpoint, at least 1.05 times the straight line,
    any yaw; whether the target is in sight doesn't matter. Fewer where the building has no more such places.

    (habitat-lab ``datasets/object_nav``: ``closest_dist_limit``, ``furthest_dist_limit``, ``geodesic_to_euclid_min_ratio``.)
    """
    rng = np.random.default_rng([seed, zlib.crc32(goals.label.encode()), 1])
    starts: list[Start] = []
    for floor, cell, path_m, straight_m in _candidates(navigation, goals, max_path_m, rng):
        if len(starts) == count:
            break
        if path_m < min_path_m or path_m < MIN_DETOUR * straight_m:
            continue
        starts.append(_start_at(navigation.floors[floor], cell, goals, rng))
    return starts


def _start_at(
    floor: FloorNavigation, cell: NDArray[np.int64], goals: Goals, rng: np.random.Generator, notes: tuple[str, ...] = ()
) -> Start:
    """A start in a cell, its yaw drawn."""
    x, y = floor.grid.centres_of(cell)
    yaw_rad = float(rng.uniform(-math.pi, math.pi))
    return Start((float(x), float(y), floor.z_m), floor.id, yaw_rad, goals.field.at((x, y), floor.id), notes)


def _out_of_sight(floor: FloorNavigation, cell: NDArray[np.int64], goals: Goals, caster: RayCaster) -> bool:
    """Whether no point of a goal is seen from a cell, whatever direction it lies in."""
    eye = eyes_over(floor, cell[None])
    # Few points show most of what is in sight; only what looks hidden is worth all of them.
    return all(visible_share(caster, eye, p)[0] == 0.0 for p in (goals.surface[::16], goals.surface))


def _candidates(
    navigation: NavigationMap, goals: Goals, max_path_m: float, rng: np.random.Generator
) -> list[tuple[str, NDArray[np.int64], float, float]]:
    """Places in random order: floor, cell, way and straight line to the nearest viewpoint of its floor [m]."""
    found: list[tuple[str, NDArray[np.int64], float, float]] = []
    for name in sorted(goals.viewpoints):
        f = navigation.floors[name]
        distance = goals.field.distance_m[name]
        ground = navigation.robot_area[name] & (distance <= max_path_m)
        indoors = ground & f.indoor
        cells = np.argwhere(indoors if indoors.any() else ground)
        cells = cells[rng.permutation(len(cells))[:_MAX_START_CANDIDATES]]
        xy = f.grid.centres_of(cells)
        straight, _ = cKDTree(goals.viewpoints[name]).query(xy)
        ways = distance[cells[:, 0], cells[:, 1]]
        found += [(name, c, float(w), float(s)) for c, w, s in zip(cells, ways, straight, strict=True)]
    return [found[i] for i in rng.permutation(len(found))]


def judge(goals: Goals, state: StateLike, *, shortest_path_m: float) -> Verdict:
    """Whether a search succeeded, by the simulator's truth. ``shortest_path_m`` is the start's."""
    distance_m = goals.field.at(state.p_world, state.floor)
    # A robot that was put on top of a viewpoint has nothing to walk: any path is as good as its own length.
    longest = max(shortest_path_m, state.path_m)
    efficiency = shortest_path_m / longest if longest > 0 else 1.0
    progress = max(0.0, 1.0 - distance_m / shortest_path_m) if shortest_path_m > 0 else float(distance_m <= SUCCESS_M)
    success = state.stopped and distance_m <= SUCCESS_M
    return Verdict(
        success=success,
        success_at_0_2_m=state.stopped and distance_m <= 0.2,
        success_at_1_m=state.stopped and distance_m <= 1.0,
        distance_to_viewpoint_m=distance_m,
        spl=float(success) * efficiency,
        soft_spl=progress * efficiency,
        path_m=state.path_m,
        shortest_path_m=shortest_path_m,
    )
