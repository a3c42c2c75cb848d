"""How good depth from real pictures is: the depth network and floor contact against a depth sensor. Prints tables.

    .venv/bin/python -m tests.bench.bench_real_depth FOLDER [--every 10]

FOLDER: ``data`` of github.com/andyzeng/tsdf-fusion-python, the 1,000 frames of 7-Scenes' red kitchen. It isn't part of this
repository, and may be used for research only.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.perception.depth import DepthEstimate, DepthNetwork, Reference, reference_depth
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import EstimatedDepthConfig
from surveilnav.services.fusion.core.views.floor_fit import fit_floor
from training.depth.evaluate import Samples, joined, measured, table
from training.depth.floor import floor_mask

#: The depth camera, as the folder says; ``NEAREST_M`` to ``FARTHEST_M`` is what its sensor is good for.
DEPTH = Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
NEAREST_M, FARTHEST_M = 0.4, 4.0
#: The colour camera, another one, for which 7-Scenes gives no calibration. Found by moving the edges of depth over the colours'
#: gradients in 40 frames: focal length, centre and the offset between the cameras are those with the highest gradient there.
COLOUR, OFFSET_M = Pinhole(640, 480, 527.0, 527.0, 322.4, 237.2), np.array([-0.0306, 0.0025, 0.0], np.float32)
#: Frames whose points are searched for the floor, points of each, and tries.
_FLOOR_EVERY, _FLOOR_POINTS, _TRIES = 10, 4000, 4000
BANDS_M = ((0.0, 2.0), (2.0, 4.0))
_STEP = 3
_MUCH_FLOOR = 0.1
#: A thing's foot: over a pixel of the floor there is one so many rows higher that is this high above it [m].
_FOOT_ROWS, _FOOT_HEIGHT_M = 8, (0.03, 0.15)


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture, and the sensor's depth (480, 640) [m] as the colour camera would see it; 0 where there is none.

    ``T_world_camera``: of the colour camera, in a world whose z points up and whose floor is at 0.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    T_world_camera: Matrix4


@dataclass(frozen=True, eq=False)
class FloorPlane:
    """The floor in the folder's world: ``normal`` . p = ``offset_m``, and how far its points are from it."""

    normal: NDArray[np.float64]
    offset_m: float
    sigma_m: float
    share: float

    def to_upright(self) -> Matrix4:
        """(4, 4) from the folder's world to one whose z points up from the floor."""
        x = np.cross(self.normal, (0.3, 0.5, 0.8))
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.stack([x, np.cross(self.normal, x), self.normal])
        T[2, 3] = -self.offset_m
        return T


def raw_depth_m(folder: Path, i: int) -> NDArray[np.float32]:
    """(480, 640) [m] as the depth camera saw it."""
    millimetres = cv2.imread(str(folder / f"frame-{i:06d}.depth.png"), cv2.IMREAD_UNCHANGED)
    depth_m = millimetres.astype(np.float32) / 1000.0
    return np.where((depth_m >= NEAREST_M) & (depth_m <= FARTHEST_M), depth_m, np.float32(0.0))


def seen_by_colour(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """The sensor's depth in the pixels of the colour camera; the nearest where several meet."""
    points = DEPTH.back_project(depth_m)[depth_m > 0] + OFFSET_M
    uv = np.rint(COLOUR.project(points)).astype(int)
    inside = ((uv >= 0) & (uv < (COLOUR.width_px, COLOUR.height_px))).all(axis=-1)
    out = np.full(depth_m.shape, np.inf, np.float32)
    np.minimum.at(out, (uv[inside, 1], uv[inside, 0]), points[inside, 2])
    return np.where(np.isfinite(out), out, np.float32(0.0))


def cloud(folder: Path, numbers: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(points (N, 3) of the depth camera in the folder's world, mean upward direction of the camera)."""
    rng, points, ups = np.random.default_rng(0), [], []
    for i in numbers:
        T = np.loadtxt(folder / f"frame-{i:06d}.pose.txt")
        depth_m = raw_depth_m(folder, i)
        seen = DEPTH.back_project(depth_m)[depth_m > 0]
        points.append(seen[rng.choice(len(seen), _FLOOR_POINTS)] @ T[:3, :3].T + T[:3, 3])
        ups.append(-T[:3, 1])
    return np.concatenate(points), np.mean(ups, axis=0) / np.linalg.norm(np.mean(ups, axis=0))


def find_floor(points: NDArray[np.float64], up: NDArray[np.float64]) -> FloorPlane:
    """The lowest plane that many points are on (RANSAC; Fischler & Bolles 1981), refined by least squares.

    Planes are tried through three points of one frame. A plane loses for each point that is below it, and may be tilted by up
    to 45 degrees against the camera's mean upward direction.
    """
    rng, some = np.random.default_rng(0), points[::8]
    best, found = -math.inf, (up, 0.0)
    frame = rng.integers(len(points) // _FLOOR_POINTS, size=(_TRIES, 1))
    for corner in points[frame * _FLOOR_POINTS + rng.integers(_FLOOR_POINTS, size=(_TRIES, 3))]:
        normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        length = np.linalg.norm(normal)
        if length < 1e-3 or abs(normal @ up) < 0.7 * length:
            continue
        normal *= np.sign(normal @ up) / length
        height_m = some @ normal - corner[0] @ normal
        score = float((np.abs(height_m) < 0.02).mean() - 2.0 * (height_m < -0.06).mean())
        if score > best:
            best, found = score, (normal, float(corner[0] @ normal))
    return refined_plane(points, *found)


def refined_plane(points: NDArray[np.float64], normal: NDArray[np.float64], offset_m: float) -> FloorPlane:
    """The plane by the points that are within 3 cm of it."""
    for _ in range(10):
        near = np.abs(points @ normal - offset_m) < 0.03
        centre = points[near].mean(axis=0)
        other = np.linalg.svd(points[near] - centre, full_matrices=False)[2][2]
        normal = other * np.sign(other @ normal)
        offset_m = float(centre @ normal)
    height_m = points[near] @ normal - offset_m
    return FloorPlane(normal, offset_m, float(height_m.std()), float(near.mean()))


def frames(folder: Path, numbers: Sequence[int], floor: FloorPlane) -> Iterator[Frame]:
    """The frames by number."""
    T_colour_depth = np.eye(4)
    T_colour_depth[:3, 3] = OFFSET_M
    for i in numbers:
        bgr = cv2.imread(str(folder / f"frame-{i:06d}.color.jpg"))
        T_world_depth = floor.to_upright() @ np.loadtxt(folder / f"frame-{i:06d}.pose.txt")
        depth_m = seen_by_colour(raw_depth_m(folder, i))
        yield Frame(bgr[..., ::-1].copy(), depth_m, T_world_depth @ np.linalg.inv(T_colour_depth))


def with_wrong_pose(T_world_camera: Matrix4, height_share: float, pitch_rad: float) -> Matrix4:
    """The pose as an imprecise calibration would have it: higher by a share of the height, and looking further down."""
    T = T_world_camera.copy()
    T[2, 3] *= 1.0 + height_share
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    T[:3, :3] = T[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return T


def fitted_by_fusion(frame: Frame, T_world_camera: Matrix4, estimate: DepthEstimate) -> NDArray[np.float32] | None:
    """The depth as fusion maps it: without what is too uncertain, and corrected by the floor; None: not used."""
    depth_m, uncertainty = estimate.for_maps()
    height_m = float(T_world_camera[2, 3])
    view = PosedView(
        "camera/c",
        0,
        0,
        0,
        "f",
        T_world_camera,
        COLOUR,
        height_m,
        frame.rgb,
        depth_m,
        (0.1, 100.0),
        "network",
        uncertainty,
    )
    fit = fit_floor(view, EstimatedDepthConfig())
    return None if fit is None else fit.depth_m


def samples_of(frame: Frame, reference: Reference, depth_m: NDArray[np.float32], sigma: NDArray[np.float32]) -> Samples:
    """Every third pixel of every third row that the sensor measured."""
    true = reference_depth(COLOUR, frame.T_world_camera, 0.0)
    above_m = true.height_m + frame.depth_m * (COLOUR.rays() @ frame.T_world_camera[2, :3].astype(np.float32))
    there = (frame.depth_m > 0)[::_STEP, ::_STEP]
    is_floor = floor_mask(np.where(frame.depth_m > 0, frame.depth_m, 1e3), true.depth_m, true.floor, true.height_m)
    arrays = (frame.depth_m, depth_m, reference.depth_m, sigma, is_floor, above_m > 0.1, reference.floor)
    return Samples(*(array[::_STEP, ::_STEP][there] for array in arrays))


def floor_share(frame: Frame) -> float:
    """Share of the measured pixels that show the floor."""
    true = reference_depth(COLOUR, frame.T_world_camera, 0.0)
    known = frame.depth_m > 0
    is_floor = floor_mask(np.where(known, frame.depth_m, 1e3), true.depth_m, true.floor, true.height_m)
    return float(is_floor[known].mean())


def foot_errors(frame: Frame) -> NDArray[np.float64]:
    """(N, 2): where a thing meets the floor, (the floor's depth there, that minus the thing's by the sensor) [m]."""
    true = reference_depth(COLOUR, frame.T_world_camera, 0.0)
    above_m = true.height_m + frame.depth_m * (COLOUR.rays() @ frame.T_world_camera[2, :3].astype(np.float32))
    known = frame.depth_m > 0
    low = known & true.floor & (np.abs(above_m) < 0.02)
    high = known & (above_m > _FOOT_HEIGHT_M[0]) & (above_m < _FOOT_HEIGHT_M[1])
    rows, columns = np.nonzero(low[_FOOT_ROWS:] & high[:-_FOOT_ROWS])
    foot_m = true.depth_m[rows + _FOOT_ROWS, columns]
    thing_m = frame.depth_m[rows, columns]
    upright = np.abs(thing_m / foot_m - 1.0) < 0.1  # else it is the edge of something that stands nearer, or a far wall
    return np.stack([foot_m[upright], (foot_m - thing_m)[upright]], axis=-1)


def print_floor(folder: Path) -> FloorPlane:
    """Finds the floor, and prints how certain it is."""
    numbers = range(0, 1000, _FLOOR_EVERY)
    points, up = cloud(folder, numbers)
    floor = find_floor(points, up)
    halves = [refined_plane(half, floor.normal, floor.offset_m) for half in np.array_split(points, 2)]
    apart_deg = math.degrees(math.acos(min(1.0, float(halves[0].normal @ halves[1].normal))))
    middle = points[np.abs(points @ floor.normal - floor.offset_m) < 0.03].mean(axis=0)
    apart_m = abs(
        float(middle @ halves[0].normal) - halves[0].offset_m - float(middle @ halves[1].normal) + halves[1].offset_m
    )
    height_m = points @ floor.normal - floor.offset_m
    counts, edges = np.histogram(height_m[height_m > 0.3], bins=np.arange(0.3, 1.2, 0.02))
    top_m = float(edges[counts.argmax()]) + 0.01
    top = refined_plane(points, floor.normal, floor.offset_m + top_m)
    tilt_deg = math.degrees(math.acos(min(1.0, float(top.normal @ floor.normal))))
    print(
        f"floor: {100 * floor.share:.1f} % of the points, sigma {1000 * floor.sigma_m:.0f} mm, "
        f"{100 * (height_m < -0.06).mean():.3f} % lie lower. First and second half of the frames: {1000 * apart_m:.0f} mm and "
        f"{apart_deg:.2f} degrees apart. Most points above it are at {100 * top_m:.0f} cm, the table, whose top is tilted by "
        f"{tilt_deg:.2f} degrees against it."
    )
    return floor


def print_poses(seen: Sequence[Frame]) -> None:
    heights = [f.T_world_camera[2, 3] for f in seen]
    pitch = [math.degrees(math.asin(f.T_world_camera[2, 2])) for f in seen]
    roll = [math.degrees(math.atan2(f.T_world_camera[2, 0], -f.T_world_camera[2, 1])) for f in seen]
    for name, values, unit in (("height", heights, "m"), ("pitch", pitch, "degrees"), ("roll", roll, "degrees")):
        print(f"{name}: " + ", ".join(f"{q:.1f}" for q in np.quantile(values, (0, 0.1, 0.5, 0.9, 1))) + f" {unit}")


def print_contact(feet: NDArray[np.float64]) -> None:
    error_m, (nearest_m, farthest_m) = np.abs(feet[:, 1]), np.quantile(feet[:, 0], (0.05, 0.95))
    print(
        f"floor contact at {len(feet)} pixels, {nearest_m:.1f} to {farthest_m:.1f} m away: median "
        f"{100 * np.median(error_m):.1f} cm ({100 * np.median(error_m / feet[:, 0]):.1f} %), 90 % below "
        f"{100 * np.quantile(error_m, 0.9):.1f} cm, mean {100 * feet[:, 1].mean():+.1f} cm\n"
    )


def evaluate(seen: Sequence[Frame], network: DepthNetwork, height_share: float, pitch_rad: float) -> list[str]:
    """Tables of the network alone, and as fusion maps it."""
    alone, mapped, n_refused = [], [], 0
    for frame in seen:
        T = with_wrong_pose(frame.T_world_camera, height_share, pitch_rad)
        reference = reference_depth(COLOUR, T, 0.0)
        estimate = network.estimate(frame.rgb, COLOUR, T, 0.0)
        alone.append(samples_of(frame, reference, estimate.depth_m, estimate.sigma_log))
        fitted = fitted_by_fusion(frame, T, estimate)
        n_refused += fitted is None
        if fitted is not None:
            mapped.append(samples_of(frame, reference, fitted, estimate.sigma_log))
    texts = [table("with this", measured(joined(alone), joined(alone), len(alone), BANDS_M))]
    if mapped:
        texts.append(
            table("as fusion maps them, with this", measured(joined(mapped), joined(mapped), len(mapped), BANDS_M))
        )
    return [*texts, f"fusion uses no depth of {n_refused} views"]


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=10)
    args = parser.parse_args()
    floor = print_floor(args.folder)
    seen = list(frames(args.folder, range(0, 1000, args.every), floor))
    print_poses(seen)
    feet = np.concatenate([foot_errors(frame) for frame in seen])
    print_contact(feet)
    network = DepthNetwork()
    print("\n\n".join(evaluate(seen, network, 0.0, 0.0)) + "\n")
    shows_floor = [frame for frame in seen if floor_share(frame) > _MUCH_FLOOR]
    print("those that show much of the floor:\n\n" + "\n\n".join(evaluate(shows_floor, network, 0.0, 0.0)) + "\n")
    for sign in (1, -1):
        print(f"the height wrong by {3 * sign} % and the pitch by {sign} degree:\n")
        print("\n\n".join(evaluate(seen, network, sign * 0.03, sign * math.radians(1.0))) + "\n")


if __name__ == "__main__":
    main()
