"""How much of a building robots can reach, and why not the rest: said in one sentence for everybody.

Much of what people draw can't be driven to: a level without a floor, a stair that ends in a wall, a closed door. Whoever
opens a building tells (``Reach.sentence``), before anybody wonders why a search failed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.robot_body import HEIGHT_M
from surveilnav.simulator.world.barriers import LONGEST_NAME, barriers_of
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.goals import within_reach
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Floor, Room, Scene

#: Smaller pieces of floor are gaps between furniture, not places that somebody misses [m2].
_PIECE_M2 = 1.0
#: So many reasons, and so many rooms and doors of one, are said.
_MAX_REASONS, _MAX_NAMES = 6, 3


@dataclass(frozen=True, slots=True)
class FloorReach:
    """One level: where a robot could stand indoors, and where robots get to [m2]."""

    id: str
    name: str
    free_m2: float
    reached_m2: float


@dataclass(frozen=True)
class Reach:
    """``floors`` from the lowest; ``gaps``: for people, what robots can't reach and why, empty if they reach all of it."""

    floors: tuple[FloorReach, ...]
    gaps: tuple[str, ...]

    @property
    def free_m2(self) -> float:
        """Where a robot could stand indoors, if it were put there."""
        return sum(floor.free_m2 for floor in self.floors)

    @property
    def reached_m2(self) -> float:
        """The connected part of it where robots live."""
        return sum(floor.reached_m2 for floor in self.floors)

    @cached_property
    def sentence(self) -> str:
        """ "robots reach 39 of 118 m²: no floor is drawn on level 2"; empty if nothing is missing."""
        if not self.gaps:
            return ""
        more = len(self.gaps) - _MAX_REASONS
        said = [*self.gaps[:_MAX_REASONS], *([f"and {more} more"] if more > 0 else [])]
        return f"robots reach {self.reached_m2:.0f} of {self.free_m2:.0f} m²: {'; '.join(said)}"


@dataclass(frozen=True)
class Survey:
    """What there is to search in a building.

    ``targets``: by class, how many robots can get to, and how many there are. ``notes``: the building's.
    ``reached_open_m2``: what robots would reach if every door were open: where not even that is all, the plan has no way.
    """

    reach: Reach
    reached_open_m2: float
    rooms: int
    targets: dict[str, tuple[int, int]]
    notes: tuple[str, ...]


def survey(scene: Scene, navigation: NavigationMap, caster: RayCaster | None = None) -> Survey:
    """Floors, rooms, and which things robots can get to (Habitat's rule of viewpoints): 0.1 to some seconds."""
    caster = caster or RayCaster(scene)
    targets = within_reach(scene, navigation, scene.labels_by_id, caster)
    reach = reach_of(scene, navigation)
    open_m2 = reach.reached_m2
    if reach.reached_m2 < reach.free_m2:
        doorless = _without_doors(scene)
        floors = _areas(doorless, NavigationMap.build(doorless))
        open_m2 = max(open_m2, sum(floor.reached_m2 for floor in floors))
    return Survey(reach, open_m2, len(scene.rooms), targets, scene.notes)


def _without_doors(scene: Scene) -> Scene:
    """The building with every leaf and frame taken off."""
    doors = [instance.id for instance in scene.instances if instance.label == "door"]
    stays = ~np.isin(scene.instance_of_triangle, doors)
    return replace(
        scene,
        triangles=scene.triangles[stays],
        uvs=scene.uvs[stays],
        material_of_triangle=scene.material_of_triangle[stays],
        instance_of_triangle=scene.instance_of_triangle[stays],
    )


def reach_of(scene: Scene, navigation: NavigationMap) -> Reach:
    """How much of each level robots reach, and what they don't."""
    levels = _levels(scene, navigation)
    shut_off = (gap for floor, f in levels for gap in _shut_off(scene, navigation, floor, f))
    return Reach(
        _areas(scene, navigation),
        tuple(dict.fromkeys([*_whole_levels(scene, navigation, levels), *navigation.notes, *shut_off])),
    )


def _levels(scene: Scene, navigation: NavigationMap) -> list[tuple[Floor, FloorNavigation]]:
    return [(floor, navigation.floors[floor.id]) for floor in scene.floors if floor.id in navigation.floors]


def _areas(scene: Scene, navigation: NavigationMap) -> tuple[FloorReach, ...]:
    return tuple(
        FloorReach(floor.id, floor.name, _m2(f, f.free & f.indoor), _m2(f, navigation.robot_area[floor.id] & f.indoor))
        for floor, f in _levels(scene, navigation)
    )


def _m2(floor: FloorNavigation, cells: NDArray[np.bool_]) -> float:
    return float(cells.sum()) * floor.grid.resolution_m**2


def _whole_levels(
    scene: Scene, navigation: NavigationMap, levels: Sequence[tuple[Floor, FloorNavigation]]
) -> Iterator[str]:
    """Levels that robots don't get to at all, those of one reason together."""
    alike: dict[str, list[str]] = {}
    for floor, f in levels:
        if _m2(f, navigation.robot_area[floor.id]) < _PIECE_M2 and (why := _why_not(scene, navigation, floor, f)):
            alike.setdefault(why, []).append(floor.id)
    for why, ids in alike.items():
        yield f"{why} level{'s' if len(ids) > 1 else ''} {', '.join(ids)}"


def _why_not(scene: Scene, navigation: NavigationMap, floor: Floor, f: FloorNavigation) -> str:
    """Why robots can't get to a level, as the beginning of a sentence that ends with the level's id. Empty if the notes on its
    stairs say it already."""
    if _m2(f, f.component == 1) < _PIECE_M2:  # the largest piece
        if floor.height_m < HEIGHT_M:
            return "the ceiling is too low for a robot on"
        bare = not any(room.floor == floor.id for room in scene.rooms) or _m2(f, f.supported) < _PIECE_M2
        return "no floor is drawn on" if bare else "there is hardly room for a robot on"
    if not any(floor.id in (s.lower_floor, s.upper_floor) for s in scene.stairs):
        return "no stair leads to"
    joined = any(floor.id in (t.lower_floor, t.upper_floor) for t in navigation.transits)
    return "no stair leads from where robots live to" if joined else ""


def _shut_off(scene: Scene, navigation: NavigationMap, floor: Floor, f: FloorNavigation) -> Iterator[str]:
    """The pieces that no way leads to of a level where robots live, with the rooms that they lie in and the reasons."""
    area = navigation.robot_area[floor.id]
    if _m2(f, area) < _PIECE_M2:
        return
    beyond = np.where(f.free & f.indoor & ~area, f.component, 0)
    sizes = np.bincount(beyond.ravel())
    pieces = [n for n in range(1, len(sizes)) if sizes[n] * f.grid.resolution_m**2 >= _PIECE_M2]
    if not pieces:
        return
    shut = np.isin(beyond, pieces)
    rooms = sorted(
        {room.name.strip()[:LONGEST_NAME] for room in scene.rooms if room.floor == floor.id and _holds(room, f, shut)}
        - {""}
    )
    why = barriers_of(scene, f, area, np.where(shut, beyond, 0))
    yield (
        f"no way leads to {_m2(f, shut):.0f} m² of level {floor.id}"
        + (f" ({_listed(rooms)})" if rooms else "")
        + (f": {_listed(why)}" if why else "")
    )


def _listed(names: Sequence[str]) -> str:
    """The first few names, and how many more there are."""
    more = len(names) - _MAX_NAMES
    return ", ".join([*names[:_MAX_NAMES], *([f"{more} more"] if more > 0 else [])])


def _holds(room: Room, f: FloorNavigation, cells: NDArray[np.bool_]) -> bool:
    """Whether a piece's worth of the cells lies in a room."""
    corners = f.grid.cells_of(np.asarray(room.polygon_m, dtype=np.float64).reshape(-1, 2))[:, ::-1]
    inside = np.zeros(f.grid.shape, dtype=np.uint8)
    cv2.fillPoly(inside, [np.ascontiguousarray(corners, dtype=np.int32)], 1)
    return _m2(f, cells & (inside != 0)) >= _PIECE_M2
