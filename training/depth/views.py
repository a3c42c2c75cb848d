"""Training views of one building for the depth network: where cameras hang, and what is rendered for each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from surveilnav.camera_plan import PITCH_RAD
from surveilnav.config import cache_dir
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.simulator.render.picture import Lighting
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.world.cameras import CAMERA, MOUNTING_M
from surveilnav.simulator.world.labels import word_for
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Instance, Scene
from training.depth.pack import DepthView, ViewGeometry, rolled
from training.detector import classes
from training.detector.poses import Kind, PoseSource, ViewPose

#: Side of the stored pictures. They are rendered at twice that, and reduced as a network's input is reduced.
SIDE_PX = 256
_SUPERSAMPLING = 2
_PROBE_PX = 64
_DOWN_RAD = -math.pi / 2
#: The camera plan's kinds of view; one in 13 looks straight down.
_PLANNED_SHARE, _PLANNED_DOWN_SHARE = 0.4, 1 / 13
#: Of other cameras: height [m], pitch, field of view, the share that looks straight down, standard deviation of roll.
_HEIGHTS_M, _TILTS_RAD, _HFOVS_RAD = (1.8, 3.0), np.radians((-50.0, -15.0)), np.radians((70.0, 110.0))
_DOWN_SHARE, _ROLL_RAD = 0.1, math.radians(1.0)
#: So many views are turned to a thing; most cameras in use weren't.
_AIMED_SHARE = 0.3
#: So many of the other cameras hang on the wall behind them, at this distance; else somewhere above free floor.
_ON_WALL_SHARE, _FROM_WALL_M, _WALL_WITHIN_M = 0.6, (0.1, 0.3), 5.0
#: A view whose middle depth is less shows a wall, or the inside of furniture. After some tries, it is taken all the same.
_CRAMPED_M, _TRIES = 0.8, 8


def camera_how(kind: Kind, rng: np.random.Generator) -> tuple[float, float, float]:
    """Height [m], pitch and field of view [rad] of a camera."""
    if rng.random() < _PLANNED_SHARE:
        return MOUNTING_M, _DOWN_RAD if rng.random() < _PLANNED_DOWN_SHARE else PITCH_RAD, CAMERA.hfov_rad
    pitch = _DOWN_RAD if rng.random() < _DOWN_SHARE else rng.uniform(*_TILTS_RAD)
    return rng.uniform(*_HEIGHTS_M), pitch, rng.uniform(*_HFOVS_RAD)


class ViewSource:
    """Renders views of one building. ``navigation``: of the building as it was furnished first."""

    def __init__(self, scene: Scene, navigation: NavigationMap, light: Lighting) -> None:
        names = classes.load()

        def number_of(instance: Instance) -> int:
            return names.number_of(word_for(instance.name, instance.label))

        self._renderer = Renderer(scene, lighting=light, cache_dir=cache_dir())
        self._poses = PoseSource(scene, navigation, number_of, camera_how, _AIMED_SHARE)
        self._floor_z_m = {floor.id: floor.z_m for floor in scene.floors}

    def views(self, n: int, seed: int) -> Iterator[DepthView]:
        """``n`` views, the same for the same seed."""
        rng = np.random.default_rng([seed, 11])
        for _ in range(n):
            yield self._view(*self._draw(rng))

    def _draw(self, rng: np.random.Generator) -> tuple[ViewPose, ViewGeometry]:
        for _ in range(_TRIES):
            pose = self._poses.draw("camera", rng)
            planned = pose.hfov_rad == CAMERA.hfov_rad
            pitch = math.asin(np.clip(pose.T_world_camera[2, 2], -1.0, 1.0))
            roll = 0.0 if planned else rng.normal(0.0, _ROLL_RAD)
            T = rolled(pose.T_world_camera, roll)
            if not planned and not pose.aimed_at and rng.random() < _ON_WALL_SHARE:
                T = self._moved_to_wall(T, rng.uniform(*_FROM_WALL_M))
            pose = replace(pose, T_world_camera=T)
            seen = self._renderer.render(T, pose.camera((_PROBE_PX, _PROBE_PX)), colors=False)
            if np.median(seen.depth_m) >= _CRAMPED_M:
                break
        height_m = float(T[2, 3]) - self._floor_z_m[pose.floor]
        return pose, ViewGeometry(pose.hfov_rad, height_m, pitch, roll, planned)

    def _moved_to_wall(self, T_world_camera: Matrix4, gap_m: float) -> Matrix4:
        """The pose moved back, in its height, to ``gap_m`` before the wall or furniture behind it."""
        back = -T_world_camera[:3, 2] * (1.0, 1.0, 0.0)
        length = np.linalg.norm(back)
        if length < 0.1:  # it looks straight down
            return T_world_camera
        back /= length
        origin, direction = T_world_camera[:3, 3].astype(np.float32), back.astype(np.float32)
        hits = self._renderer.caster.cast(origin[None], direction[None])
        way_m = float(hits.t[0]) - gap_m
        T = T_world_camera.copy()
        if 0.0 < way_m < _WALL_WITHIN_M:
            T[:3, 3] += way_m * back
        return T

    def _view(self, pose: ViewPose, geometry: ViewGeometry) -> DepthView:
        # Depth isn't reduced from the large picture, but rendered at the centres of the stored pixels: so the floor's depth
        # is exactly the reference depth.
        T, camera = pose.T_world_camera, geometry.camera(SIDE_PX)
        side = SIDE_PX * _SUPERSAMPLING
        large = self._renderer.render(T, Pinhole.from_hfov(side, side, geometry.hfov_rad))
        rgb = cv2.resize(large.rgb, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)
        depth_m = self._renderer.render(T, camera, colors=False).depth_m
        return DepthView(geometry, rgb.astype(np.uint8), depth_m.astype(np.float16))
