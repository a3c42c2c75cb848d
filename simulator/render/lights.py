"""Where a building's light comes from: a lamp below every ceiling, soft daylight through every window."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Room, Scene

#: Linear colours: lamps a little warm, the sky a little cool.
LAMP_COLOR = (1.06, 1.0, 0.90)
SKY_COLOR = (0.94, 0.99, 1.06)
_LAMP_INTENSITY = 3.0  # light of 0.5 on the floor below it
_LAMP_RADIUS_M = 0.25
_LAMP_AREA_M2 = 14.0  # one lamp for so much floor
_SKY_RADIANCE = 3.2


@dataclass(frozen=True, slots=True, eq=False)
class Lights:
    """All lights of a building (L of them), as arrays for compiled loops.

    Attributes:
        position: (L, 3) float32 [m, world].
        extent: (L, 2, 3) float32: half axes of the parallelogram that shines.
        normal: (L, 3) float32: zero for lamps, which shine everywhere; the axis of windows, which shine both ways.
        color: (L, 3) float32: intensity of lamps; radiance x area of windows.
    """

    position: NDArray[np.float32]
    extent: NDArray[np.float32]
    normal: NDArray[np.float32]
    color: NDArray[np.float32]


def lights_of(scene: Scene, caster: RayCaster) -> Lights:
    """Lamps of all rooms and daylight of all windows; a scene without rooms gets lamps on a grid."""
    lamps = [p for room in scene.rooms for p in _room_lamps(scene, room)]
    if not scene.rooms:
        lamps = _grid_lamps(scene)
    position: list[object] = []
    extent: list[object] = []
    normal: list[object] = []
    color: list[object] = []
    for p in _below_ceilings(lamps, caster):
        position.append(p)
        extent.append([[_LAMP_RADIUS_M, 0.0, 0.0], [0.0, _LAMP_RADIUS_M, 0.0]])
        normal.append([0.0, 0.0, 0.0])
        color.append(np.array(LAMP_COLOR) * _LAMP_INTENSITY)
    for instance in scene.labelled("window"):
        low, high = np.array(instance.p_min), np.array(instance.p_max)
        size = high - low
        if not np.isfinite(size).all() or size[2] < 0.2 or max(size[0], size[1]) < 0.2:
            continue
        along, across = (0, 1) if size[0] >= size[1] else (1, 0)
        axis, half = np.zeros(3), np.zeros(3)
        axis[across], half[along] = 1.0, 0.4 * size[along]
        position.append((low + high) / 2)
        extent.append([half, [0.0, 0.0, 0.4 * size[2]]])
        normal.append(axis)
        color.append(np.array(SKY_COLOR) * _SKY_RADIANCE * min(size[along] * size[2], 4.0))
    count = len(position)
    return Lights(
        np.array(position, np.float32).reshape(count, 3),
        np.array(extent, np.float32).reshape(count, 2, 3),
        np.array(normal, np.float32).reshape(count, 3),
        np.array(color, np.float32).reshape(count, 3),
    )


def _room_lamps(scene: Scene, room: Room) -> list[tuple[float, float, float, float]]:
    """(x, y, z of the floor, height) of a room's lamps: far from its walls, and from each other in large rooms."""
    outline = np.array(room.polygon_m, dtype=np.float64).reshape(-1, 2)
    if len(outline) < 3 or not np.isfinite(outline).all():
        return []
    try:
        floor = scene.floor(room.floor)
    except KeyError:
        return []
    low, cell = outline.min(axis=0) - 0.3, 0.1
    shape = np.minimum(np.ceil((outline.max(axis=0) + 0.3 - low) / cell).astype(int), 2000)
    inside = np.zeros((shape[1], shape[0]), dtype=np.uint8)
    cv2.fillPoly(inside, [np.round((outline - low) / cell).astype(np.int32)], 1)
    area_m2 = float(inside.sum()) * cell * cell
    if area_m2 < 0.5:
        return []
    lamps = []
    rows, cols = np.mgrid[: inside.shape[0], : inside.shape[1]]
    room_left = inside.copy()
    for _ in range(min(12, max(1, round(area_m2 / _LAMP_AREA_M2)))):
        clearance = cv2.distanceTransform(room_left, cv2.DIST_L2, 5)
        if clearance.max() * cell < 0.2:
            break
        # Among all cells about as clear as the clearest, the one nearest to their middle.
        best = clearance >= 0.9 * clearance.max()
        middle = np.array([rows[best].mean(), cols[best].mean()])
        nearest = np.argmin((rows[best] - middle[0]) ** 2 + (cols[best] - middle[1]) ** 2)
        row, col = rows[best][nearest], cols[best][nearest]
        lamps.append((low[0] + col * cell, low[1] + row * cell, floor.z_m, floor.height_m))
        cv2.circle(room_left, (int(col), int(row)), int(1.6 / cell), 0, -1)
    return lamps


def _grid_lamps(scene: Scene) -> list[tuple[float, float, float, float]]:
    finite = scene.vertices[np.isfinite(scene.vertices).all(axis=1)]
    if not len(finite):
        return []
    low, high = np.percentile(finite, 1, axis=0), np.percentile(finite, 99, axis=0)
    floors = [(f.z_m, f.height_m) for f in scene.floors] or [(float(low[2]), 2.6)]
    xs = np.arange(low[0] + 1.5, max(high[0], low[0] + 2.0), 3.5)[:20]
    ys = np.arange(low[1] + 1.5, max(high[1], low[1] + 2.0), 3.5)[:20]
    return [(float(x), float(y), z, height) for z, height in floors for x in xs for y in ys]


def _below_ceilings(lamps: list[tuple[float, float, float, float]], caster: RayCaster) -> list[NDArray[np.float32]]:
    """Lamp positions 0.3 m below what is above them; none under the sky (terraces)."""
    if not lamps:
        return []
    p = np.array([(x, y, z + 1.6) for x, y, z, _ in lamps], dtype=np.float32)
    up = caster.cast(p, np.tile(np.array([0, 0, 1], dtype=np.float32), (len(p), 1))).t
    placed = []
    for (x, y, z, height), clear in zip(lamps, up, strict=True):
        if not np.isfinite(clear) or clear > 4.0:
            continue
        lamp_z = min(z + 1.6 + max(float(clear) - 0.3, 0.1), z + max(height, 2.0) - 0.15)
        placed.append(np.array([x, y, lamp_z], dtype=np.float32))
    return placed
