"""Pictures of a scene's floors: what cameras see, where they hang, where episodes start and goals stand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.integrity import damage, read_manifest
from surveilnav.benchmark.dataset.load import SceneData, load_scene, scenes_of, start_of
from surveilnav.errors import ConfigError
from surveilnav.geometry import Grid
from surveilnav.simulator.simulation import CAMERA_DEPTH_RANGE_M, SimulatedBuilding
from surveilnav.simulator.world.free_ground import FloorNavigation

_SCALE = 3  # pixels a cell
_LEGEND_PX = 540
#: BGR
_COLORS: dict[str, tuple[int, int, int]] = {
    "chair": (60, 140, 230),
    "bed": (190, 80, 150),
    "potted plant": (60, 150, 60),
    "toilet": (200, 160, 40),
    "tv": (40, 40, 40),
    "couch": (60, 60, 200),
}


class Drawn(NamedTuple):
    """A scene's picture; ``area_m2`` of its floors indoors, and how much of it cameras have in sight."""

    path: Path
    area_m2: float
    seen_m2: float


def draw(root: Path, split: str, scene: str, out: Path) -> Drawn:
    """Writes ``<out>/<split>/<scene>.png``; floors from the lowest on, side by side.

    Raises:
        ConfigError: no such scene, its files were changed, or the picture can't be written.
    """
    manifest = read_manifest(root)
    if scene not in scenes_of(root, split):
        raise ConfigError(f"{root} has no scene {scene!r} in {split}; see {root / split / 'scenes'}")
    if any(damage(root, manifest, split, scene)):
        raise ConfigError(f"files of {split}/{scene} aren't what they were: `surveilnav dataset check` says which")
    data = load_scene(root, split, scene)
    building = open_scene(data.record, lighting="flat")
    data.check_scene(building.scene)
    drawn = [_floor(building, data, floor) for floor in building.navigation.floors.values()]
    floors = [image for image, _, _ in drawn]
    height = max(f.shape[0] for f in floors)
    image = np.hstack([np.pad(f, ((0, height - f.shape[0]), (0, 0), (0, 0)), constant_values=255) for f in floors])
    path = out / split / f"{scene}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), image):
        raise ConfigError(f"{path} can't be written")
    return Drawn(path, sum(area_m2 for _, area_m2, _ in drawn), sum(seen_m2 for _, _, seen_m2 in drawn))


def _floor(
    building: SimulatedBuilding, data: SceneData, floor: FloorNavigation
) -> tuple[NDArray[np.uint8], float, float]:
    """A floor's picture, its surface indoors and what cameras have in sight of it [m2]."""
    cameras = [c for c in data.plan(100).cameras if c.floor == floor.id]
    covered = np.zeros(floor.grid.shape, dtype=np.bool_)
    for camera in cameras:
        covered |= seen_floor(building, floor, camera.position_m)
    image = _ground(floor, covered)
    _draw_searches(image, building, data, floor)
    for camera in cameras:
        at = _pixel(floor.grid, camera.position_m[:2])
        cv2.circle(image, at, 7, (0, 110, 255), -1, cv2.LINE_AA)
        cv2.circle(image, at, 7, (0, 0, 0), 1, cv2.LINE_AA)
    for transit in building.navigation.transits:
        if floor.id in (transit.lower_floor, transit.upper_floor):
            cv2.drawMarker(
                image, _pixel(floor.grid, transit.end_on(floor.id)[:2]), (200, 0, 200), cv2.MARKER_TRIANGLE_UP, 12, 2
            )
    rows, cols = np.nonzero(floor.supported | floor.obstacle)
    image = image[
        max(0, rows.min() - 4) * _SCALE : (rows.max() + 5) * _SCALE,
        max(0, cols.min() - 4) * _SCALE : (cols.max() + 5) * _SCALE,
    ]
    indoors = floor.supported & floor.indoor
    cell_m2 = floor.grid.resolution_m**2
    area_m2, seen_m2 = float(indoors.sum()) * cell_m2, float((covered & indoors).sum()) * cell_m2
    share = seen_m2 / max(area_m2, cell_m2)
    title = f"{data.record.scene} floor {floor.id}: {floor.floor_area_m2:.0f} m2, {len(cameras)} cameras see {100 * share:.0f} %"
    return _labelled(image[::-1], title), area_m2, seen_m2


def _ground(floor: FloorNavigation, covered: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """What is floor, indoors, in a camera's sight, and in the way."""
    image = np.full((*floor.grid.shape, 3), 255, np.uint8)
    image[floor.supported] = 222
    image[floor.supported & floor.indoor] = 240
    image[covered & floor.supported] = (200, 235, 205)
    image[floor.obstacle] = 130
    return np.repeat(np.repeat(image, _SCALE, axis=0), _SCALE, axis=1)


def _draw_searches(
    image: NDArray[np.uint8], building: SimulatedBuilding, data: SceneData, floor: FloorNavigation
) -> None:
    """Boxes of the goals, arrows where episodes start."""
    goals = {int(goal.object_id) for found in data.content.goals_by_category.values() for goal in found}
    for instance in building.scene.instances:
        if instance.floor == floor.id and instance.id in goals:
            low, high = _pixel(floor.grid, instance.p_min[:2]), _pixel(floor.grid, instance.p_max[:2])
            cv2.rectangle(image, low, high, _COLORS[instance.label], 2)
    for episode in data.content.episodes:
        start = start_of(episode, building.scene)
        if start.floor == floor.id:
            tip = (start.p_m[0] + 0.35 * math.cos(start.yaw_rad), start.p_m[1] + 0.35 * math.sin(start.yaw_rad))
            color = _COLORS[data.label_of(episode)]
            cv2.arrowedLine(image, _pixel(floor.grid, start.p_m[:2]), _pixel(floor.grid, tip), color, 1, cv2.LINE_AA)


def _labelled(image: NDArray[np.uint8], title: str) -> NDArray[np.uint8]:
    """With a title above and a legend below."""
    short = max(0, _LEGEND_PX - image.shape[1])
    image = np.ascontiguousarray(np.pad(image, ((22, 24), (4, 8 + short), (0, 0)), constant_values=255))
    cv2.putText(image, title, (6, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (40, 40, 40), 1, cv2.LINE_AA)
    x, below = 6, image.shape[0] - 8
    for word, color in (*_COLORS.items(), ("green: in a camera's sight", (40, 40, 40))):
        cv2.putText(image, word, (x, below), cv2.FONT_HERSHEY_SIMPLEX, 0.45, color, 1, cv2.LINE_AA)
        x += cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)[0][0] + 14
    return np.asarray(image, dtype=np.uint8)


def seen_floor(
    building: SimulatedBuilding, floor: FloorNavigation, p_camera: tuple[float, float, float]
) -> NDArray[np.bool_]:
    """Cells of a floor's surface that a camera at ``p_camera`` has in sight and range."""
    cells = np.argwhere(floor.supported)
    xy = floor.grid.centres_of(cells)
    near = np.linalg.norm(xy - np.array(p_camera[:2]), axis=1) < CAMERA_DEPTH_RANGE_M[1]
    cells, xy = cells[near], xy[near]
    seen = np.zeros(floor.grid.shape, dtype=np.bool_)
    if len(cells):
        ground = np.column_stack([xy, np.full(len(xy), floor.z_m + 0.1)]).astype(np.float32)
        eye = np.broadcast_to(np.array(p_camera, dtype=np.float32), ground.shape)
        clear = ~building.caster.occluded(eye, ground)
        seen[cells[clear, 0], cells[clear, 1]] = True
    return seen


def _pixel(grid: Grid, p_m: tuple[float, ...]) -> tuple[int, int]:
    row, col = (
        float(v)
        for v in ((p_m[1] - grid.origin_y_m) / grid.resolution_m, (p_m[0] - grid.origin_x_m) / grid.resolution_m)
    )
    return round(col * _SCALE), round(row * _SCALE)
