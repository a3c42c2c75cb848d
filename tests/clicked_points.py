"""Points that a made-up camera sees, as somebody would click them: for tests and for tests/bench/bench_camera_pose.py."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.geometry.lens import BrownConrady, Lens

LENS = BrownConrady(Pinhole(1280, 960, 900.0, 900.0, 639.5, 479.5))
#: 2.5 m high, looking along +x and 25 degrees down.
T_WORLD_CAMERA = camera_pose((0.0, 0.0, 2.5), 0.0, math.radians(-25.0))


@dataclass(frozen=True, eq=False)
class Scene:
    """Pixels (n, 2) and places (n, 3) [m] of points, without errors unless ``with_errors`` added them."""

    pixels: NDArray[np.float64]
    p_world: NDArray[np.float64]

    def with_errors(self, rng: np.random.Generator, sigma_px: float = 2.0, sigma_m: float = 0.02) -> Scene:
        """As clicked: both the pixel and the place are off; the height only of points that aren't on the floor."""
        place_errors = rng.normal(0.0, sigma_m, self.p_world.shape)
        place_errors[self.p_world[:, 2] == 0.0, 2] = 0.0
        return Scene(self.pixels + rng.normal(0.0, sigma_px, self.pixels.shape), self.p_world + place_errors)


def scene(
    rng: np.random.Generator,
    n: int,
    door_tops: bool,
    lens: Lens = LENS,
    T_world_camera: Matrix4 = T_WORLD_CAMERA,
    ahead_m: tuple[float, float] = (1.0, 9.0),
    margin_px: float = 12.0,
) -> Scene:
    """``n`` points in view, anywhere on the floor ahead of the camera; with ``door_tops`` each third one is 2 m high."""
    places: list[NDArray[np.float64]] = []
    pixels: list[NDArray[np.float64]] = []
    size = np.array([lens.pinhole.width_px, lens.pinhole.height_px])
    while len(places) < n:
        height_m = 2.0 if door_tops and len(places) % 3 == 2 else 0.0
        p_world = np.array([rng.uniform(*ahead_m), rng.uniform(-5.0, 5.0), height_m])
        p_world[:2] += T_world_camera[:2, 3]
        pixel = lens.pixels((p_world - T_world_camera[:3, 3]) @ T_world_camera[:3, :3])
        if (pixel > margin_px).all() and (pixel < size - margin_px).all():
            places.append(p_world)
            pixels.append(pixel)
    return Scene(np.array(pixels), np.array(places))


def pose_error(T_found: Matrix4, T_true: Matrix4) -> NDArray[np.float64]:
    """(6,): position [m] and rotation vector [rad] in the world's axes that lead from the true pose to the one found."""
    R = T_found[:3, :3] @ T_true[:3, :3].T
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = np.linalg.norm(axis) / 2
    angle = math.atan2(sine, (np.trace(R) - 1) / 2)
    rotation = axis / (2 * sine) * angle if sine > 1e-12 else axis / 2
    return np.concatenate([T_found[:3, 3] - T_true[:3, 3], rotation])
