"""Where surveillance cameras hang: the paper's construction (section III-B, step 2 and 3).

One camera per 100 m2 of floor (every floor at least one), 1.8 m high, over places where a robot can stand; bad
viewpoints are skipped; farthest-point sampling spreads the rest. The paper doesn't say which distance: we take the
way a robot would walk, so that two rooms that share a wall count as far apart. Each camera records 13 views: 12 at
-30 degrees every 30 degrees of azimuth, and one straight down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_plan import AZIMUTHS, views_around
from surveilnav.errors import ConfigError
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.simulator.world.free_ground import FloorNavigation
from surveilnav.simulator.world.geodesic import spread
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Scene

MOUNTING_M = 1.8
#: The paper's: 1280x1280 pixels, 100 degrees (section V-A).
CAMERA = Pinhole.from_hfov(1280, 1280, math.radians(100.0))

_CANDIDATES = 600
_DIRECTIONS = 256
#: A viewpoint is bad if something is nearer than this, ...
_NEAREST_M = 0.15
#: ... if half of what it sees is nearer than this (inside a wardrobe, under a shelf), ...
_MEDIAN_M = 0.9
#: ... or if more than this share of its views shows nothing at all (the paper's "black pixels").
_NOTHING = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """A camera of the plan.

    Attributes:
        name: "c0-1": number of the floor from below, number of the camera on it; can stand in a key.
        position_m: (x, y, z) in the world, ``MOUNTING_M`` above its floor.
        views: 13 ``T_world_camera``: 0-11 at -30 degrees with azimuth 30 degrees times the number, 12 straight down.
        half_from: first azimuth of the half that sees most.
    """

    name: str
    floor: str
    position_m: tuple[float, float, float]
    views: tuple[Matrix4, ...]
    half_from: int

    def half(self) -> tuple[int, ...]:
        """The numbers of six neighbouring azimuths: the paper's half views, turned to where there is most to see."""
        return tuple((self.half_from + i) % AZIMUTHS for i in range(AZIMUTHS // 2))


def place_cameras(
    scene: Scene,
    navigation: NavigationMap,
    *,
    area_per_camera_m2: float = 100.0,
    count: int | None = None,
    seed: int = 0,
    caster: RayCaster | None = None,
    everywhere: bool = False,
) -> tuple[PlacedCamera, ...]:
    """The camera plan of a building; the same arguments give the same plan.

    Args:
        area_per_camera_m2: each floor gets its area indoors divided by this, rounded up (the paper doesn't say how it
            rounds; so every floor has one).
        count: this many in all instead, spread over the floors by area, on every floor at least one if they suffice.
        seed: draws the candidates.
        everywhere: also on floors that robots can't get to: over the largest part that one could stand in.

    Raises:
        ConfigError: a density or count that makes no sense.
    """
    if not (area_per_camera_m2 > 0 and math.isfinite(area_per_camera_m2)):
        raise ConfigError(f"the area per camera is a positive number of square metres, got {area_per_camera_m2}")
    if count is not None and not 0 <= count <= 10_000:
        raise ConfigError(f"a building has 0 to 10000 cameras, got {count}")
    caster = caster or RayCaster(scene)
    standable = {name: _standable(navigation, name, everywhere) for name in navigation.floors}
    areas = [f.floor_area_m2 if standable[f.id].any() else 0.0 for f in navigation.floors.values()]
    if count is None:
        shares = [math.ceil(area / area_per_camera_m2 - 1e-9) if area > 0 else 0 for area in areas]
    else:
        shares = _spread_count(count, areas)
    cameras: list[PlacedCamera] = []
    for index, (floor, wanted) in enumerate(zip(navigation.floors.values(), shares, strict=True)):
        rng = np.random.default_rng([seed, index])
        places, seen_m = _places(floor, standable[floor.id], wanted, caster, rng)
        cameras += [
            _camera_at(f"c{index}-{number}", floor, xy, seen)
            for number, (xy, seen) in enumerate(zip(places, seen_m, strict=True), start=1)
        ]
    return tuple(cameras)


def _camera_at(name: str, floor: FloorNavigation, xy: NDArray[np.float64], seen_m: NDArray[np.float32]) -> PlacedCamera:
    position = (float(xy[0]), float(xy[1]), floor.z_m + MOUNTING_M)
    return PlacedCamera(name, floor.id, position, tuple(views_around(position)), _best_half(seen_m))


def _standable(navigation: NavigationMap, floor: str, everywhere: bool) -> NDArray[np.bool_]:
    """Where robots live indoors on a floor; if they can't get there nowhere, or ``everywhere`` its largest free part."""
    f = navigation.floors[floor]
    area = navigation.robot_area[floor]
    if everywhere and not area.any():
        area = f.free & (f.component == f.largest_component)
    return area & f.indoor if (area & f.indoor).any() else area


def _spread_count(count: int, areas: list[float]) -> list[int]:
    """``count`` over floors by area (largest remainders), one each first, the largest floors first."""
    order = sorted((i for i, a in enumerate(areas) if a > 0), key=lambda i: (-areas[i], i))
    shares = [0] * len(areas)
    if not order:
        return shares
    for i in order[:count]:
        shares[i] = 1
    total = sum(areas)
    for _ in range(count - sum(shares)):  # the floor that is furthest below its share gets the next
        shares[max(order, key=lambda i: (count * areas[i] / total - shares[i], -i))] += 1
    return shares


def _places(
    floor: FloorNavigation, standable: NDArray[np.bool_], wanted: int, caster: RayCaster, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """(n, 2) places and what each sees (n, directions) [m]: the most open candidate, then always the farthest one."""
    cells = np.argwhere(standable)
    if wanted == 0 or len(cells) == 0:
        return np.empty((0, 2)), np.empty((0, _DIRECTIONS), dtype=np.float32)
    wanted = min(wanted, len(cells))
    cells = cells[rng.permutation(len(cells))[: max(_CANDIDATES, 4 * wanted)]]
    xy = floor.grid.centres_of(cells)
    seen_m, badness = _look_around(caster, xy, floor.z_m)
    # Skip the bad ones; where too few are good the least bad ones fill up.
    keep = np.argsort(badness, kind="stable")[: max(wanted, int((badness == 0).sum()))]
    cells, xy, seen_m = cells[keep], xy[keep], seen_m[keep]
    openness = (_indoors(seen_m) ** 2).mean(axis=1)
    chosen = _farthest_points(floor, cells, int(np.argmax(openness)), wanted)
    return xy[chosen], seen_m[chosen]


def _farthest_points(floor: FloorNavigation, cells: NDArray[np.int64], first: int, wanted: int) -> list[int]:
    """So many of the ``cells`` (n, 2), from the first on always the one that is the longest way from all before."""
    chosen = [first]
    nearest = np.full(len(cells), np.inf)
    while len(chosen) < wanted:
        flat = np.ravel_multi_index(tuple(cells[chosen[-1]]), floor.grid.shape)
        distance, _ = spread(floor.free, np.array([flat], dtype=np.int64), np.zeros(1))
        nearest = np.minimum(nearest, distance.reshape(floor.grid.shape)[cells[:, 0], cells[:, 1]])
        nearest[chosen] = -1.0
        chosen.append(int(np.argmax(nearest)))
    return chosen


def _look_around(
    caster: RayCaster, xy: NDArray[np.float64], floor_z_m: float
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """What cameras above ``xy`` (n, 2) would see: range (n, directions) [m], inf for nothing; and badness (n,).

    Badness is 0 for a good viewpoint, above 0 for one that should be skipped, the higher the worse.
    """
    eye = np.empty((len(xy), 1, 3), dtype=np.float32)
    eye[:, 0, :2], eye[:, 0, 2] = xy, floor_z_m + MOUNTING_M
    directions = _directions()
    seen_m = caster.cast(eye, np.broadcast_to(directions, (len(xy), _DIRECTIONS, 3))).t
    nothing = np.isinf(seen_m).mean(axis=1)
    too_near = np.maximum(0.0, 1.0 - seen_m.min(axis=1) / _NEAREST_M)
    cramped = np.maximum(0.0, 1.0 - np.median(seen_m, axis=1) / _MEDIAN_M)
    # Under a low ceiling or inside a tall body: no way up from where the robot's camera would be.
    head = eye[:, 0] - np.array([0.0, 0.0, MOUNTING_M - 1.0], dtype=np.float32)
    walled_off = caster.occluded(head, eye[:, 0]).astype(np.float64)
    return seen_m, np.maximum(0.0, nothing - _NOTHING) + too_near + cramped + walled_off


def _indoors(seen_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ranges up to 10 m; what leaves through a window counts as nothing, or every camera would look out of one."""
    return np.minimum(np.where(np.isinf(seen_m), 0.0, seen_m), 10.0).astype(np.float32)


def _directions() -> NDArray[np.float32]:
    """(n, 3) unit vectors evenly over all that the 13 views see together: from straight down to 20 degrees up."""
    i = np.arange(_DIRECTIONS) + 0.5
    up = -1.0 + i / _DIRECTIONS * (1.0 + math.sin(math.radians(20.0)))
    azimuth = math.pi * (1.0 + math.sqrt(5.0)) * i  # Fibonacci's spiral
    level = np.sqrt(1.0 - up**2)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=-1).astype(np.float32)


def _best_half(seen_m: NDArray[np.float32]) -> int:
    """The first of the six neighbouring azimuths before which the most open volume lies."""
    directions = _directions()
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    volume = _indoors(seen_m) ** 3
    middles = (np.arange(AZIMUTHS) + (AZIMUTHS // 2 - 1) / 2) * 2 * math.pi / AZIMUTHS
    before = np.cos(azimuth[None, :] - middles[:, None]) > 0
    return int(np.argmax((volume[None, :] * before).sum(axis=1)))
