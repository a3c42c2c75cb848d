"""Where training views are taken from: at robots' and cameras' heights, most of them turned to something.

Looking anywhere shows walls most of the time, and rare classes almost never. So most views are aimed: a class that the
building has is drawn, then one of its things, then a free place near it; the thing lies anywhere in the picture.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_plan import PITCH_RAD
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.robot_body import CAMERA_HEIGHT_M, LOOK_RAD
from surveilnav.simulator.world.cameras import CAMERA, MOUNTING_M
from surveilnav.simulator.world.labels import TARGETS
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Instance, Scene

Kind = Literal["robot", "camera"]

#: What training packs hold: the robot's picture at half of its resolution, and a camera's as detectors see it.
TRAINING_SIZES: dict[Kind, tuple[int, int]] = {"robot": (320, 240), "camera": (416, 416)}
#: What the sensors take.
SENSOR_SIZES: dict[Kind, tuple[int, int]] = {"robot": (640, 480), "camera": (CAMERA.width_px, CAMERA.height_px)}
ROBOT_HFOV_RAD = math.radians(79.0)
#: The camera plan's own kind of view (height, tilt, field of view), and what else hangs on walls.
_USUAL = (MOUNTING_M, PITCH_RAD, CAMERA.hfov_rad)
_HEIGHTS_M, _TILTS_RAD, _HFOVS_RAD = (1.8, 2.6), np.radians((-50.0, -15.0)), np.radians((70.0, 110.0))
_USUAL_SHARE, _AIMED_SHARE = 0.4, 0.8
#: Of aimed views: at one of the searches' goals.
_GOAL_SHARE = 0.5
_BELOW_CEILING_M = 0.15
#: Things are aimed at from these distances, and lie at most this share of half the field of view off the middle.
_NEAR_M, _FAR_M = 0.7, {"robot": 6.0, "camera": 9.0}
_OFF_MIDDLE = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class ViewPose:
    """A view before it is rendered. ``aimed_at``: id of the instance that it should show, 0: anything."""

    kind: Kind
    T_world_camera: Matrix4
    hfov_rad: float
    floor: str
    aimed_at: int

    def camera(self, size: tuple[int, int], scale: float = 1.0) -> Pinhole:
        """Its intrinsics at ``scale`` times ``size`` (width, height) [pixels]."""
        width, height = (round(side * scale) for side in size)
        return Pinhole.from_hfov(width, height, self.hfov_rad)


#: Draws height [m], pitch and field of view [rad] of a view.
How = Callable[[Kind, np.random.Generator], tuple[float, float, float]]


def usual_how(kind: Kind, rng: np.random.Generator) -> tuple[float, float, float]:
    """Height [m], pitch and field of view [rad]."""
    if kind == "robot":
        pitch = -LOOK_RAD * rng.integers(2) + rng.normal(0.0, math.radians(1.5))
        return CAMERA_HEIGHT_M + rng.normal(0.0, 0.02), pitch, ROBOT_HFOV_RAD
    if rng.random() < _USUAL_SHARE:
        return _USUAL
    return rng.uniform(*_HEIGHTS_M), rng.uniform(*_TILTS_RAD), rng.uniform(*_HFOVS_RAD)


class PoseSource:
    """Draws poses in one building.

    ``number_of``: the class of an instance, or -1. ``how``: draws a height [m], pitch and field of view [rad] in place of the
    usual ones. ``aimed_share``: so many views are aimed.
    """

    def __init__(
        self,
        scene: Scene,
        navigation: NavigationMap,
        number_of: Callable[[Instance], int],
        how: How | None = None,
        aimed_share: float = _AIMED_SHARE,
    ) -> None:
        self._how, self._aimed_share = how or usual_how, aimed_share
        self._floors = {f.id: f for f in scene.floors if navigation.robot_area[f.id].any()}
        self._cells: dict[str, NDArray[np.float64]] = {}
        for id_ in self._floors:
            grid = navigation.floors[id_].grid
            self._cells[id_] = grid.centres_of(np.argwhere(navigation.robot_area[id_]))
        by_class: defaultdict[int, list[Instance]] = defaultdict(list)
        for instance in scene.instances:
            if instance.floor in self._floors and (number := number_of(instance)) >= 0:
                by_class[number].append(instance)
        self._by_class = [by_class[number] for number in sorted(by_class)]
        self._goals = [things for things in self._by_class if things[0].label in TARGETS]

    def draw(self, kind: Kind, rng: np.random.Generator) -> ViewPose:
        """One pose, aimed or not."""
        height_m, pitch, hfov = self._how(kind, rng)
        if self._by_class and rng.random() < self._aimed_share:
            kinds = self._goals if self._goals and rng.random() < _GOAL_SHARE else self._by_class
            things = kinds[rng.integers(len(kinds))]
            thing = things[rng.integers(len(things))]
            place = self._place_near(thing, kind, rng)
            if place is not None:
                middle = (np.array(thing.p_min) + np.array(thing.p_max)) / 2
                yaw = math.atan2(middle[1] - place[1], middle[0] - place[0])
                yaw += _OFF_MIDDLE * rng.uniform(-0.5, 0.5) * hfov
                return self._pose(kind, thing.floor, place, height_m, yaw, pitch, hfov, thing.id)
        floor = list(self._floors)[rng.integers(len(self._floors))]
        place = self._cells[floor][rng.integers(len(self._cells[floor]))]
        return self._pose(kind, floor, place, height_m, rng.uniform(-math.pi, math.pi), pitch, hfov, 0)

    def _place_near(self, thing: Instance, kind: Kind, rng: np.random.Generator) -> NDArray[np.float64] | None:
        """(x, y) [m] of a free cell, near ones as likely as far ones; None: there is none in reach."""
        cells = self._cells[thing.floor]
        low, high = np.array(thing.p_min[:2]), np.array(thing.p_max[:2])
        gap = np.maximum(np.maximum(low - cells, cells - high), 0.0)
        away = np.hypot(gap[:, 0], gap[:, 1])
        wanted = rng.uniform(_NEAR_M, _FAR_M[kind])
        near = np.flatnonzero(np.abs(away - wanted) < 0.25)
        return cells[near[rng.integers(len(near))]] if len(near) else None

    def _pose(
        self,
        kind: Kind,
        floor: str,
        place: NDArray[np.float64],
        height_m: float,
        yaw: float,
        pitch: float,
        hfov: float,
        aimed_at: int,
    ) -> ViewPose:
        storey = self._floors[floor]
        z = storey.z_m + min(height_m, storey.height_m - _BELOW_CEILING_M)
        T = camera_pose((float(place[0]), float(place[1]), z), yaw, pitch)
        return ViewPose(kind, T, hfov, floor, aimed_at)
