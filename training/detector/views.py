"""Training views of one building: what is rendered, and what of it can be seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from surveilnav import robot_body
from surveilnav.config import cache_dir
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.picture import Lighting, Rendered
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.simulation import CAMERA_DEPTH_RANGE_M
from surveilnav.simulator.world.labels import word_for
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Instance, Room, Scene
from training.detector.classes import Classes
from training.detector.poses import SENSOR_SIZES, TRAINING_SIZES, Kind, PoseSource, ViewPose

#: What shows fewer pixels of the packed picture, or is thinner, is no object of a view.
MIN_AREA_PX, MIN_SIDE_PX = 24, 4
#: Numbers that an id picture of bytes holds beside 0.
MAX_OBJECTS = 255
#: A view is looked at once at this share of its resolution, without colours, before it is worth a picture.
_PROBE = 0.25
_PROBE_PX = 6
_TRIES = 8
#: Middle depth below which a view looks at a wall or from inside a piece of furniture.
_CRAMPED_M = 0.6
#: What sensors do to depth, and the range that they measure [m].
_NOISE = {"robot": DepthNoise.robot(), "camera": DepthNoise.camera()}
DEPTH_RANGE_M: dict[Kind, tuple[float, float]] = {"robot": robot_body.DEPTH_RANGE_M, "camera": CAMERA_DEPTH_RANGE_M}
#: The point that a view looks at lies at most so far away.
_LOOKS_AT_M = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class TrainingView:
    """One picture and what a network should say of it.

    Attributes:
        kind, light: of the view; ``hfov_rad``: its field of view.
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32 [m] with a sensor's noise and range, 0: none.
        ids: (H, W) uint8, 0: nothing named, i + 1: object i.
        boxes: (N, 4) float32 (x0, y0, x1, y1) [pixels] of what shows of each object.
        labels: (N,) int64 class of each.
        areas: (N,) int64 pixels that each shows.
        near: (C,) bool, whether something of each class shows or stands in the room that the view looks into.
        room: kind of that room, -1: unknown.
    """

    kind: Kind
    light: str
    hfov_rad: float
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    ids: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]
    areas: NDArray[np.int64]
    near: NDArray[np.bool_]
    room: int


class ViewSource:
    """Renders views of one building.

    ``navigation``: of the building as it was furnished first. ``light``: of the renderer. ``as_sensed``: at the size that
    sensors take, for evaluation. Otherwise pictures are rendered at twice their size and reduced, as a network's input is
    reduced; rays for shadows are too dear for that.
    """

    def __init__(
        self, scene: Scene, navigation: NavigationMap, light: Lighting, classes: Classes, *, as_sensed: bool = False
    ) -> None:
        self._light, self._classes = light, classes
        self._renderer = Renderer(scene, lighting=light, cache_dir=cache_dir())
        numbers = [classes.number_of(word_for(i.name, i.label)) for i in scene.instances]
        self._number = np.array([-1, *numbers], np.int64)
        self._poses = PoseSource(scene, navigation, self._number_of)
        self._rooms = _Rooms(scene, self._number, classes)
        self._sizes = SENSOR_SIZES if as_sensed else TRAINING_SIZES
        self._scale = 1.0 if as_sensed or light == "shadowed" else 2.0

    def _number_of(self, instance: Instance) -> int:
        return int(self._number[instance.id])

    def views(self, kind: Kind, n: int, seed: int) -> Iterator[TrainingView]:
        """``n`` views, the same for the same seed."""
        rng = np.random.default_rng([seed, kind == "camera"])
        for _ in range(n):
            yield self.view(self._worthwhile(kind, rng), int(rng.integers(2**31)))

    def _worthwhile(self, kind: Kind, rng: np.random.Generator) -> ViewPose:
        """A pose that shows what it was aimed at, or anything if it wasn't; after some tries, whatever comes."""
        for _ in range(_TRIES):
            pose = self._poses.draw(kind, rng)
            seen = self._renderer.render(pose.T_world_camera, pose.camera(TRAINING_SIZES[kind], _PROBE), colors=False)
            if np.median(seen.depth_m) < _CRAMPED_M:
                continue
            named = self._number[seen.instance_ids] >= 0
            wanted = seen.instance_ids == pose.aimed_at if pose.aimed_at else named
            if wanted.sum() >= _PROBE_PX:
                break
        return pose

    def view(self, pose: ViewPose, seed: int = 0) -> TrainingView:
        """The picture from a pose, with everything that a network should say of it. ``seed``: of the depth's noise."""
        rendered = self._renderer.render(
            pose.T_world_camera,
            pose.camera(self._sizes[pose.kind], self._scale),
            depth_range_m=DEPTH_RANGE_M[pose.kind],
            noise=_NOISE[pose.kind],
            seed=seed,
        )
        rgb, ids, depth_m = reduced(rendered, round(self._scale))
        small, boxes, labels, areas = objects_in(ids, self._number)
        room, near = self._rooms.looked_into(pose, depth_m)
        near = near.copy()
        near[labels] = True
        return TrainingView(
            pose.kind, self._light, pose.hfov_rad, rgb, depth_m, small, boxes, labels, areas, near, room
        )


def reduced(rendered: Rendered, factor: int) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float32]]:
    """Colours averaged over squares of ``factor`` pixels; of ids and depths the square's lower right middle."""
    if factor == 1:
        return rendered.rgb, rendered.instance_ids, rendered.depth_m
    height, width = rendered.depth_m.shape
    rgb = cv2.resize(rendered.rgb, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    middle = np.s_[factor // 2 :: factor, factor // 2 :: factor]
    return rgb.astype(np.uint8), rendered.instance_ids[middle].copy(), rendered.depth_m[middle].copy()


def objects_in(
    ids: NDArray[np.uint16], number: NDArray[np.int64]
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """What of a picture's instances (H, W) shows enough: (ids as of ``TrainingView``, boxes, labels, areas), the largest
    first. ``number``: class by instance, -1: none."""
    found = [(area, id_, box) for id_, area, box in visible_boxes(ids, len(number) - 1) if number[id_] >= 0]
    found = sorted(found, key=lambda f: (-f[0], f[1]))[:MAX_OBJECTS]
    table = np.zeros(len(number), np.uint8)
    table[[id_ for _, id_, _ in found]] = np.arange(1, len(found) + 1)
    boxes = np.array([box for _, _, box in found], np.float32).reshape(-1, 4)
    return table[ids], boxes, number[[i for _, i, _ in found]], np.array([a for a, _, _ in found], np.int64)


def visible_boxes(ids: NDArray[np.integer], highest: int) -> Iterator[tuple[int, int, tuple[int, int, int, int]]]:
    """Id, area [pixels] and box (x0, y0, x1, y1) of each of the ids 1 to ``highest`` that shows enough to be an object."""
    areas = np.bincount(ids.ravel(), minlength=highest + 1)
    for id_, place in enumerate(ndimage.find_objects(ids.astype(np.int32), max_label=highest), start=1):
        if place is None or areas[id_] < MIN_AREA_PX:
            continue
        rows, cols = place
        if min(rows.stop - rows.start, cols.stop - cols.start) >= MIN_SIDE_PX:
            yield id_, int(areas[id_]), (cols.start, rows.start, cols.stop, rows.stop)


class _Rooms:
    """Which room a view looks into, and what stands there."""

    def __init__(self, scene: Scene, number: NDArray[np.int64], classes: Classes) -> None:
        self._n_classes = len(classes.names)
        self._of_floor: dict[str, list[tuple[NDArray[np.float32], int, NDArray[np.bool_]]]] = {}
        for room in scene.rooms:
            polygon = np.array(room.polygon_m, np.float32)
            near = self._things_in(room, polygon, scene, number)
            self._of_floor.setdefault(room.floor, []).append((polygon, classes.room_of(room.name), near))

    def _things_in(
        self, room: Room, polygon: NDArray[np.float32], scene: Scene, number: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        near = np.zeros(self._n_classes, bool)
        for thing in scene.instances:
            if thing.floor != room.floor or number[thing.id] < 0:
                continue
            x, y = ((thing.p_min[k] + thing.p_max[k]) / 2 for k in (0, 1))
            if cv2.pointPolygonTest(polygon, (x, y), measureDist=False) >= 0:
                near[number[thing.id]] = True
        return near

    def looked_into(self, pose: ViewPose, depth_m: NDArray[np.float32]) -> tuple[int, NDArray[np.bool_]]:
        """(kind, classes in it) of the room around the point at the view's middle depth, else the camera's own."""
        there = depth_m[depth_m > 0]
        reach = min(float(np.median(there)), _LOOKS_AT_M) if len(there) else 0.0
        T = pose.T_world_camera
        forward = T[:2, 2] / max(1e-6, math.hypot(T[0, 2], T[1, 2]))
        for ahead in (0.8 * reach, 0.0):
            x, y = T[:2, 3] + ahead * forward
            for polygon, kind, near in self._of_floor.get(pose.floor, []):
                if cv2.pointPolygonTest(polygon, (float(x), float(y)), measureDist=False) >= 0:
                    return kind, near
        return -1, np.zeros(self._n_classes, bool)
