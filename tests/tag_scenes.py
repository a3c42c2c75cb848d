"""A robot with an AprilTag that made-up cameras see: for tests and for tests/bench/bench_camera_tag.py."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag.detection import tag_corners, tag_picture
from surveilnav.camera_pose.tag.model import Observations, State
from surveilnav.camera_pose.tag.sightings import Sightings, Stop, Tag
from surveilnav.camera_pose.tag.solve import TagFit, solve_tag
from surveilnav.geometry import Matrix4, Pinhole, base_pose, camera_pose, inverse, transform_points
from surveilnav.geometry.lens import BrownConrady, Lens

_SUPERSAMPLING = 4


def tag_on_robot(
    x_m: float = 0.12, y_m: float = 0.03, height_m: float = 0.5, yaw_rad: float = 0.0, tilt_rad: float = 0.5
) -> Matrix4:
    """``T_robot_tag``: the tag faces along the robot's yaw, tilted upwards by ``tilt_rad``; its pattern stands upright."""
    looking = camera_pose((x_m, y_m, height_m), yaw_rad, tilt_rad)  # z along the tag's normal, y down
    looking[:3, :3] = looking[:3, :3] @ np.diag([-1.0, -1.0, 1.0])  # seen from the front, x is to the right and y up
    return looking


def render_tag(
    lens: Lens, T_camera_tag: Matrix4, size_m: float, id: int = 0, background: int = 110
) -> NDArray[np.uint8]:
    """(height, width, 3): a grey picture with the tag in it, on a white sheet a module wider on each side."""
    sheet = tag_picture(id, module_px=1)
    n = len(sheet)
    width, height = lens.pinhole.width_px, lens.pinhole.height_px
    picture = np.full((height, width), float(background))
    outer = lens.pixels(transform_points(T_camera_tag, tag_corners(size_m * n / (n - 2))))
    left, top = np.maximum(0, np.floor(np.nanmin(outer, axis=0) - 2)).astype(int)
    right, bottom = (
        np.minimum([width, height], np.ceil(np.nanmax(outer, axis=0)) + 3).astype(int)
        if np.isfinite(outer).all()
        else (left, top)
    )
    if right <= left or bottom <= top:
        return np.repeat(picture[..., None], 3, axis=-1).astype(np.uint8)
    k = _SUPERSAMPLING
    u = left + (np.arange((right - left) * k) + 0.5) / k - 0.5
    v = top + (np.arange((bottom - top) * k) + 0.5) / k - 0.5
    rays = lens.rays(np.stack(np.meshgrid(u, v), axis=-1)) @ T_camera_tag[:3, :3]
    origin = inverse(T_camera_tag)[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = -origin[2] / rays[..., 2]
        column = (origin[0] + along * rays[..., 0]) / size_m * (n - 2) + n / 2
        row = n / 2 - (origin[1] + along * rays[..., 1]) / size_m * (n - 2)
    on = (along > 0) & (column >= 0) & (column < n) & (row >= 0) & (row < n)
    value = np.full(on.shape, float(background))
    value[on] = 20.0 + 0.8 * sheet[row[on].astype(int), column[on].astype(int)]
    shape = bottom - top, k, right - left, k
    picture[top:bottom, left:right] = value.reshape(shape).mean(axis=(1, 3))
    return np.repeat(picture[..., None], 3, axis=-1).astype(np.uint8)


LENS = BrownConrady(Pinhole.from_hfov(1920, 1080, math.radians(85.0)))
#: 2.5 m high, looking along +x and 25 degrees down.
T_WORLD_CAMERA = camera_pose((0.0, 0.0, 2.5), 0.0, math.radians(-25.0))
_MAX_INCIDENCE_RAD = math.radians(65.0)
_MIN_SIDE_PX = 20.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Cameras and a robot with a tag.

    Attributes:
        sightings: without errors, unless ``with_errors`` added them.
    """

    lenses: dict[str, Lens]
    T_world_camera: dict[str, Matrix4]
    T_robot_tag: Matrix4
    sightings: Sightings

    def with_errors(
        self,
        rng: np.random.Generator,
        sigma_px: float = 0.4,
        sigma_m: float = 0.02,
        sigma_rad: float = math.radians(1.0),
    ) -> Scene:
        """As it is seen: the corners are off, and the robot isn't where it says."""
        stops = [
            replace(
                stop,
                x_m=stop.x_m + rng.normal(0.0, sigma_m),
                y_m=stop.y_m + rng.normal(0.0, sigma_m),
                yaw_rad=stop.yaw_rad + rng.normal(0.0, sigma_rad),
                seen={name: corners + rng.normal(0.0, sigma_px, (4, 2)) for name, corners in stop.seen.items()},
            )
            for stop in self.sightings.stops
        ]
        return replace(self, sightings=Sightings(self.sightings.tag, stops))

    def solve(self, **options: float) -> TagFit:
        """The poses that follow from the sightings."""
        return solve_tag(self.lenses, self.sightings, {"ground": 0.0}, **options)


def scene_from_poses(
    poses: NDArray[np.float64],
    T_world_camera: dict[str, Matrix4] | None = None,
    lenses: dict[str, Lens] | None = None,
    T_robot_tag: Matrix4 | None = None,
    size_m: float = 0.16,
) -> Scene:
    """The sightings of a robot that stops at ``poses`` (n, 3): x [m], y [m], yaw [rad]; also those that no camera sees."""
    cameras = T_world_camera or {"lobby": T_WORLD_CAMERA}
    lenses = lenses or dict.fromkeys(cameras, LENS)
    on_robot = tag_on_robot() if T_robot_tag is None else T_robot_tag
    stops = []
    for x, y, yaw in poses:
        T_world_tag = base_pose((x, y, 0.0), yaw) @ on_robot
        seen = {}
        for name, T in cameras.items():
            corners = seen_corners(lenses[name], inverse(T) @ T_world_tag, size_m)
            if corners is not None:
                seen[name] = corners
        stops.append(Stop("robot-1", "ground", x, y, yaw, seen))
    tag = Tag(id=0, size_m=size_m, height_m=float(on_robot[2, 3]))
    return Scene(lenses, cameras, on_robot, Sightings(tag, stops))


def seen_corners(lens: Lens, T_camera_tag: Matrix4, size_m: float) -> NDArray[np.float64] | None:
    """(4, 2) pixels of the corners; None: the tag is turned away, out of the picture or too small to be found."""
    towards = -T_camera_tag[:3, 3] / np.linalg.norm(T_camera_tag[:3, 3])
    if T_camera_tag[:3, 2] @ towards < math.cos(_MAX_INCIDENCE_RAD):
        return None
    pixels = lens.pixels(transform_points(T_camera_tag, tag_corners(size_m)))
    size = np.array([lens.pinhole.width_px, lens.pinhole.height_px])
    if not ((pixels > 3) & (pixels < size - 4)).all():
        return None
    sides = np.linalg.norm(pixels - np.roll(pixels, 1, axis=0), axis=1)
    return pixels if sides.max() > _MIN_SIDE_PX else None


def random_stops(
    rng: np.random.Generator,
    n: int,
    reach_m: tuple[float, float] = (1.5, 6.0),
    turn_rad: float = 0.9,
    size_m: float = 0.16,
) -> NDArray[np.float64]:
    """(n, 3) stops in view of the camera of ``T_WORLD_CAMERA``; the robot faces it to ``turn_rad``."""
    found: list[tuple[float, float, float]] = []
    while len(found) < n:
        distance, bearing = rng.uniform(*reach_m), rng.uniform(-0.6, 0.6)
        x, y = distance * math.cos(bearing), distance * math.sin(bearing)
        pose = x, y, bearing + math.pi + rng.uniform(-turn_rad, turn_rad)
        if scene_from_poses(np.array([pose]), size_m=size_m).sightings.stops[0].seen:
            found.append(pose)
    return np.array(found)


def exactly(scene: Scene) -> tuple[State, Observations]:
    """The true state, and what is seen."""
    names = list(scene.lenses)
    rows = [(names.index(k), i, c) for i, stop in enumerate(scene.sightings.stops) for k, c in stop.seen.items()]
    stops = np.array([(stop.x_m, stop.y_m, stop.yaw_rad) for stop in scene.sightings.stops])
    seen = Observations(
        tuple(scene.lenses.values()),
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]),
        stops,
        np.zeros(len(stops)),
        scene.sightings.tag.size_m,
        scene.sightings.tag.height_m,
    )
    return State(np.stack(list(scene.T_world_camera.values())), scene.T_robot_tag, stops), seen
