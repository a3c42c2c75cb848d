"""Our pose from clicks against a bundle adjustment's, on the pictures of four real cameras. Prints tables.

    .venv/bin/python -m tests.bench.bench_real_pose FOLDER [--draws 200]

FOLDER: ``tests/sessions/post_optimization`` of github.com/mprib/caliscope, a recording of a ChArUco board that four cameras saw.
Its corners' pixels are the clicks, and their places are those that caliscope's bundle adjustment found. It isn't part of this
repository.
"""

from __future__ import annotations

import argparse
import csv
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose import solve_pose
from surveilnav.errors import PoseError
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.geometry.lens import BrownConrady
from tests.clicked_points import pose_error

_POINTS = (4, 6, 10, 20)
#: The board's places are known to millimetres. The world's z points up, and all cameras are above this altitude.
_SIGMA_WORLD_M, _BELOW_ALL_M = 0.003, -1.0


@dataclass(frozen=True, eq=False)
class RealCamera:
    """A camera with caliscope's pose, and all corners that it saw: pixels (n, 2), places (n, 3) [m]."""

    name: str
    lens: BrownConrady
    T_world_camera: Matrix4
    pixels: NDArray[np.float64]
    p_world: NDArray[np.float64]

    def residuals_px(self) -> NDArray[np.float64]:
        """(n,): how far corners are from where caliscope's pose shows them."""
        p_camera = (self.p_world - self.T_world_camera[:3, 3]) @ self.T_world_camera[:3, :3]
        return np.asarray(np.linalg.norm(self.lens.pixels(p_camera) - self.pixels, axis=1))


def read_cameras(folder: Path) -> list[RealCamera]:
    """The cameras of a session that has been optimised."""
    with (folder / "camera_array.toml").open("rb") as file:
        described = tomllib.load(file)["cameras"]
    corners = folder / "calibration" / "extrinsic" / "CHARUCO"
    with (corners / "xyz_CHARUCO.csv").open() as file:
        places = {
            (row["sync_index"], row["keypoint_id"]): [float(row[f"{axis}_coord"]) for axis in "xyz"]
            for row in csv.DictReader(file)
        }
    seen: dict[str, list[tuple[list[float], list[float]]]] = {name: [] for name in described}
    with (corners / "xy_CHARUCO.csv").open() as file:
        for row in csv.DictReader(file):
            if place := places.get((row["sync_index"], row["keypoint_id"])):
                seen[row["cam_id"]].append(([float(row["img_loc_x"]), float(row["img_loc_y"])], place))
    return [_camera(name, entry, seen[name]) for name, entry in described.items()]


def _camera(name: str, entry: dict, seen: list[tuple[list[float], list[float]]]) -> RealCamera:
    K = np.array(entry["matrix"])
    pinhole = Pinhole(*entry["size"], K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    R = np.array(entry["rotation"])  # from the world to the camera
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R.T, -R.T @ np.array(entry["translation"])
    pixels, places = (np.array(part) for part in zip(*seen, strict=True))
    return RealCamera(name, BrownConrady(pinhole, tuple(entry["distortions"])), T, pixels, places)


def difference(
    camera: RealCamera, which: NDArray[np.int64], noise_px: NDArray[np.float64]
) -> tuple[float, float, float]:
    """(position [cm], direction [degrees], stated standard deviation of the position [cm]) of our pose. PoseError: none."""
    fit = solve_pose(
        camera.lens,
        camera.pixels[which] + noise_px,
        camera.p_world[which],
        sigma_world_m=_SIGMA_WORLD_M,
        floor_z_m=_BELOW_ALL_M,
    )
    error = pose_error(fit.T_world_camera, camera.T_world_camera)
    position, direction = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
    return 100 * float(position), math.degrees(direction), 100 * fit.position_sigma_m


def cell(cameras: list[RealCamera], n: int, sigma_px: float, draws: int) -> str:
    """Median and 90th percentile of the differences of all cameras; what is stated, and how many draws were refused."""
    found, refused = [], 0
    for camera in cameras:
        for seed in range(draws):
            rng = np.random.default_rng(seed)
            which = rng.choice(len(camera.pixels), n, replace=False)
            try:
                found.append(difference(camera, which, rng.normal(0.0, sigma_px, (n, 2))))
            except PoseError:
                refused += 1
    (cm50, deg50, stated), (cm90, deg90, _) = np.percentile(found, [50, 90], axis=0)
    return f"{cm50:.1f}, {deg50:.2f} / {cm90:.1f}, {deg90:.1f} (± {stated:.1f}; {refused} of {len(cameras) * draws})"


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, default=200)
    args = parser.parse_args()
    cameras = read_cameras(args.folder)
    print(
        "| camera | corners | distance | off by caliscope's pose | our pose from all corners |\n|---|---|---|---|---|"
    )
    for camera in cameras:
        n = len(camera.pixels)
        away_m = np.quantile(np.linalg.norm(camera.p_world - camera.T_world_camera[:3, 3], axis=1), (0.05, 0.95))
        off = camera.residuals_px()
        cm, degrees, _ = difference(camera, np.arange(n), np.zeros((n, 2)))
        print(
            f"| {camera.name} | {n} | {away_m[0]:.1f} to {away_m[1]:.1f} m | {np.median(off):.1f} px, 90 % below "
            f"{np.quantile(off, 0.9):.1f} | {cm:.2f} cm, {degrees:.2f} degrees |"
        )
    print("\n| points | corners as detected | and clicked with 2 px of noise |\n|---|---|---|")
    for n in _POINTS:
        print(f"| {n} | {cell(cameras, n, 0.0, args.draws)} | {cell(cameras, n, 2.0, args.draws)} |", flush=True)


if __name__ == "__main__":
    main()
