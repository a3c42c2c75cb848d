"""A tour of a building: what all its cameras see, and a robot that goes through it.

The robot's places are chosen by farthest-point sampling on each floor and visited nearest first by the shortest ways, with a look
around at each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from surveilnav.benchmark.play.sight import SeenView, Sight
from surveilnav.perception.backend import Backend
from surveilnav.robot_state import RobotState
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world.navigation import NavigationMap

LOOK_DOWN_RAD = math.radians(-30.0)


@dataclass(frozen=True, slots=True)
class Tour:
    """About so many views of the robot, around in such turns, and every so far on its ways."""

    views: int
    turn_rad: float
    step_m: float


def views_on(
    building: SimulatedBuilding, backend: Backend, tour: Tour, on_view: Callable[[int, int], None] | None = None
) -> list[SeenView]:
    """All cameras' views of a building, then the robot's, each with what ``backend`` saw in it. ``on_view(done, of)`` is told."""
    sight = Sight(building, backend)
    states = states_of(building.navigation, tour)
    total = sum(len(info.views) for info in sight.infos) + len(states)
    seen: list[SeenView] = []

    def add(sighted: SeenView) -> None:
        seen.append(sighted)
        if on_view is not None:
            on_view(len(seen), total)

    for info in sight.infos:
        for sighted in sight.camera(info.camera):
            add(sighted)
        sight.camera.cache_clear()
    for state in states:
        add(sight.robot(state))
    return seen


def states_of(navigation: NavigationMap, tour: Tour) -> list[RobotState]:
    """Where a robot looks from on a tour, floors by their area; ``seq`` counts from 1."""
    areas = {name: float(area.sum()) for name, area in navigation.robot_area.items() if area.any()}
    states: list[RobotState] = []
    for floor, area in areas.items():
        share = round(tour.views * area / sum(areas.values()))
        for n_places in range(max(1, round(share * tour.turn_rad / (2 * math.pi))), 0, -1):
            stops = list(_stops(navigation, floor, n_places, tour))
            if len(stops) <= share:
                break
        z_m = navigation.floors[floor].z_m
        for (x, y), yaw, pitch in stops:
            states.append(RobotState(x, y, z_m, floor, yaw, pitch, seq=len(states) + 1))
    return states


def _stops(
    navigation: NavigationMap, floor: str, n_places: int, tour: Tour
) -> Iterator[tuple[tuple[float, float], float, float]]:
    """((x, y), yaw, pitch) of every view: along the ways level, around at the places level or, at every third, down."""
    left = _places(navigation, floor, n_places)
    here = left.pop(0)
    headings = round(2 * math.pi / tour.turn_rad)
    for number in range(n_places):
        for k in range(headings):
            yaw = 2 * math.pi * k / headings
            yield here, math.remainder(yaw, 2 * math.pi), LOOK_DOWN_RAD if number % 3 == 2 else 0.0
        if not left:
            return
        field = navigation.distance_field({floor: [here]})
        there = min(left, key=lambda p: (field.at(p, floor), p))
        left.remove(there)
        way = navigation.distance_field({floor: [there]}).path_from(here, floor)
        corners = [(w.x_m, w.y_m) for w in way if w.floor == floor]
        for a, b in itertools.pairwise(corners):
            length_m, yaw = math.dist(a, b), math.atan2(b[1] - a[1], b[0] - a[0])
            for i in range(int(length_m / tour.step_m)):
                t = (i + 1) * tour.step_m / length_m
                yield (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])), yaw, 0.0
        here = there


def _places(navigation: NavigationMap, floor: str, n: int) -> list[tuple[float, float]]:
    """Farthest-point sampling by way: the place nearest to the middle first, then always the farthest one."""
    area = navigation.robot_area[floor]
    inside = area & navigation.floors[floor].indoor
    cells = np.argwhere(inside if inside.any() else area)
    xy = navigation.floors[floor].grid.centres_of(cells)
    chosen = [int(np.argmin(np.linalg.norm(xy - xy.mean(axis=0), axis=1)))]
    while len(chosen) < min(n, len(cells)):
        away = navigation.distance_field({floor: xy[chosen]}).distance_m[floor][cells[:, 0], cells[:, 1]]
        chosen.append(int(np.where(np.isfinite(away), away, -1.0).argmax()))
    return [(float(x), float(y)) for x, y in xy[chosen]]
