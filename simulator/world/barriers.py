"""What lies between the ground where robots live and ground that they can't get to: a shut door, a gap, furniture, walls."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from surveilnav.robot_body import CLIMB_M, HEIGHT_M, RADIUS_M, clearance_m
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.geodesic import occupied_cells
from surveilnav.simulator.world.labels import PARTS
from surveilnav.simulator.world.scene import Instance, Scene

#: So far from a door one looks for the ground on its two sides [m]: half of a thick wall, a robot's radius, some cells.
_BESIDE_M = 0.6
#: What stands so near to a door may be in its way [m].
_BEFORE_M = 0.4
#: A sill is lower than this [m], and ends where its door begins, or some millimetres beside.
_SILL_M, _SLACK_M = 0.5, 0.03
#: Plans are strangers': longer names are cut; more doors of a floor, and more places beside one, aren't looked at.
LONGEST_NAME, _MAX_DOORS, _MAX_PLACES = 40, 100, 12

Cells = NDArray[np.bool_]
Window = tuple[slice, slice]


def barriers_of(scene: Scene, f: FloorNavigation, area: Cells, beyond: NDArray[np.int32]) -> list[str]:
    """Why robots can't get to parts of a floor, for people: each reason once, doors first.

    Args:
        area: (rows, cols) where robots live.
        beyond: (rows, cols) numbers of the parts that they can't get to; 0 elsewhere.
    """
    layers = _Layers(scene, f)
    said: dict[str, None] = {}
    explained: set[int] = set()
    doors = (i for i in scene.instances if i.label == "door" and i.floor == f.id)
    beside = (
        (door, window) for door in doors if area[window := _around(f, door, _BESIDE_M)].any() and beyond[window].any()
    )
    for door, window in islice(beside, _MAX_DOORS):
        if why := _at_door(layers, door, window, area[window], beyond[window] > 0):
            said[why] = None
            explained.update(np.unique(beyond[window]).tolist())
    rest = (beyond > 0) & ~np.isin(beyond, list(explained))
    if rest.any() and (why := _without_door(layers, area, rest)):
        said[why] = None
    return list(said)


class _Layers:
    """Maps of the free room on one floor, as it is and with doors, furniture or sills taken away; computed on demand."""

    def __init__(self, scene: Scene, f: FloorNavigation) -> None:
        self.scene, self.f = scene, f
        #: A mesh without names may be walls or furniture: then none is left out.
        self.knows_walls = any(i.label == "wall" for i in scene.instances)
        self._room_m: dict[tuple[str, ...], NDArray[np.float32]] = {}
        self._rooms = [
            (_short(room.name), np.array(room.polygon_m, np.float32).reshape(-1, 1, 2))
            for room in scene.rooms
            if room.floor == f.id and room.polygon_m
        ]

    def room_at(self, p_world: NDArray[np.float64]) -> str:
        """The name of the room at (x, y) [m], empty if there is none."""
        point = (float(p_world[0]), float(p_world[1]))
        inside = (name for name, outline in self._rooms if cv2.pointPolygonTest(outline, point, measureDist=False) >= 0)
        return next(inside, "")

    def room_m(self, *without: str) -> NDArray[np.float32]:
        """(rows, cols) distance from what is in a robot's way [m], leaving out "door", "furniture", "sill" or "no floor"."""
        if without not in self._room_m:
            blocked = self._obstacle(without) if {"door", "furniture", "sill"} & set(without) else self.f.obstacle
            if "no floor" not in without:
                blocked = blocked | ~self.f.supported
            padded = np.pad(blocked, 1, constant_values=True)
            self._room_m[without] = clearance_m(padded, self.f.grid.resolution_m)[1:-1, 1:-1]
        return self._room_m[without]

    def _obstacle(self, without: Sequence[str]) -> Cells:
        scene, f = self.scene, self.f
        kinds = {i.id: i.label if i.label in PARTS or not self.knows_walls else "furniture" for i in scene.instances}
        out = [id_ for id_, kind in kinds.items() if kind in without]
        triangles = scene.triangles[~np.isin(scene.instance_of_triangle, out)]
        low_m = f.z_m + (_SILL_M if "sill" in without else CLIMB_M)
        return occupied_cells(f.grid, scene.vertices, triangles, low_m, f.z_m + HEIGHT_M)


def _at_door(layers: _Layers, door: Instance, window: Window, area: Cells, beyond: Cells) -> str:
    """What keeps robots from passing a door, by the cells in a ``window`` around it; empty if it leads elsewhere."""
    opening = np.zeros_like(area)
    inner = _around(layers.f, door, 0.0)
    opening[tuple(slice(i.start - w.start, i.stop - w.start) for i, w in zip(inner, window, strict=True))] = True

    def widest(*without: str) -> float:
        room_m = layers.room_m(*without)[window]
        found = _widest(room_m, area, beyond, opening)
        if found and (opening & area).any():  # robots pass it: the way may be a gap beside it
            beside = _widest(np.where(opening, 0, room_m), area & ~opening, beyond & ~opening, ~opening)
            return found if beside < found else 0.0
        return found

    title = f"the door {_short(door.name)!r}{_between(layers, window, area, beyond)}"
    if (now := widest()) > 0.0:
        thing = _before(layers, door) if widest("furniture") > RADIUS_M else None
        return f"{f'{_short(thing.name)!r} before ' if thing else ''}{title} {_leaves(now)}"
    if (doorless := widest("door")) > 0.0:
        return f"{title} {'stays shut' if doorless > RADIUS_M else _leaves(doorless)}"
    sill_m = door.p_min[2] - layers.f.z_m
    if CLIMB_M - _SLACK_M < sill_m < _SILL_M and widest("door", "sill") > RADIUS_M:
        return f"{title} {'' if widest('sill') > 0.0 else 'stays shut and '}has a sill of {sill_m:.2f} m"
    if widest("door", "furniture") > RADIUS_M and (thing := _before(layers, door)):
        return f"{_short(thing.name)!r} stands before {title}"
    return ""


def _without_door(layers: _Layers, area: Cells, beyond: Cells) -> str:
    """What lies between two grounds where no door is to blame; empty where nobody knows what is a wall."""
    everywhere = np.ones_like(area)
    bare = _widest(layers.room_m("furniture"), area, beyond, everywhere)
    if (now := _widest(layers.room_m(), area, beyond, everywhere)) > 0.0:
        return f"{'furniture' if bare > RADIUS_M else 'the gap that leads there'} {_leaves(now)}"
    if not layers.knows_walls:
        return ""
    if bare > 0.0:
        return "furniture stands in the way" if bare > RADIUS_M else f"the gap that leads there {_leaves(bare)}"
    hovering = _widest(layers.room_m("furniture", "no floor"), area, beyond, everywhere)
    return "no floor lies between" if hovering > RADIUS_M else "walls stand between"


def _leaves(clearance: float) -> str:
    """A passage by the room in its middle, which a grid knows to half a cell or so."""
    return f"leaves about {max(0.1, 2 * clearance):.1f} m, and a robot is {2 * RADIUS_M:.2f} m wide"


def _widest(room_m: NDArray[np.float32], start: Cells, end: Cells, through: Cells) -> float:
    """The most room that a way from ``start`` to ``end`` by ``through`` has at its narrowest [m]; 0.0: there is none.

    A way that is wide enough for a robot counts as exactly the smallest clearance above the robot's radius.
    """
    wide = room_m > RADIUS_M
    narrow = np.unique(room_m[(room_m > 0.0) & ~wide])
    for least in [*([room_m[wide].min()] if wide.any() else []), *narrow[::-1]]:
        parts = ndimage.label((room_m >= least) | start | end)[0]
        common = np.intersect1d(parts[start], parts[end])
        if np.isin(parts[through], common[common > 0]).any():
            return float(least)
    return 0.0


def _around(f: FloorNavigation, thing: Instance, margin_m: float) -> Window:
    """The cells of a thing's box, and so much around it."""
    low, high = np.subtract(thing.p_min[:2], margin_m), np.add(thing.p_max[:2], margin_m)
    (row0, col0), (row1, col1) = f.grid.cells_of(np.stack([low, high])).astype(int).tolist()
    return np.s_[max(0, row0) : max(0, row1 + 1), max(0, col0) : max(0, col1 + 1)]


def _before(layers: _Layers, door: Instance) -> Instance | None:
    """The largest piece of furniture that stands where a robot passes a door."""
    low, high = np.array(door.p_min), np.array(door.p_max)
    low[:2] -= _BEFORE_M
    high[:2] += _BEFORE_M
    low[2], high[2] = layers.f.z_m + CLIMB_M, layers.f.z_m + HEIGHT_M
    near = (
        i
        for i in layers.scene.instances
        if i.label not in PARTS and np.all(np.array(i.p_min) < high) and np.all(np.array(i.p_max) > low)
    )
    return max(near, key=lambda i: float(np.prod(np.subtract(i.p_max, i.p_min))), default=None)


def _between(layers: _Layers, window: Window, *sides: Cells) -> str:
    """ " between Hall and Garage": rooms of the ground nearest to a door on its two sides; empty without names."""
    corner, names = np.array([window[0].start, window[1].start]), []
    for side in sides:
        cells = np.argwhere(side)
        away = ((cells - (np.array(side.shape) - 1) / 2) ** 2).sum(axis=1)
        some = cells[np.argsort(away, kind="stable")][:: len(cells) // _MAX_PLACES + 1]
        names.append(next(filter(None, map(layers.room_at, layers.f.grid.centres_of(some + corner))), ""))
    if not all(names):
        return ""
    return f" in {names[0]}" if names[0] == names[1] else f" between {names[0]} and {names[1]}"


def _short(name: str) -> str:
    return name.strip()[:LONGEST_NAME]
