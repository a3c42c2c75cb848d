"""How exact a camera's pose from clicks is, by number of points: median and 90th percentile. Prints a table.

.venv/bin/python -m tests.bench.bench_camera_pose [--draws 300]
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from surveilnav.camera_pose import solve_pose
from surveilnav.errors import PoseError
from tests.clicked_points import LENS, T_WORLD_CAMERA, pose_error, scene

POINTS = (4, 5, 6, 10)


def cell(n: int, door_tops: bool, draws: int) -> str:
    """Errors of the poses that were found, and how many were refused."""
    errors, stated_m = [], []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        clicked = scene(rng, n, door_tops).with_errors(rng)
        try:
            fit = solve_pose(LENS, clicked.pixels, clicked.p_world)
        except PoseError:
            continue
        error = pose_error(fit.T_world_camera, T_WORLD_CAMERA)
        errors.append((np.linalg.norm(error[:3]), math.degrees(np.linalg.norm(error[3:]))))
        stated_m.append(fit.position_sigma_m)
    (m50, deg50), (m90, deg90) = np.percentile(errors, [50, 90], axis=0)
    numbers = f"{m50:.2f}, {deg50:.2f} / {m90:.2f}, {deg90:.1f}"
    return f"{numbers} (± {np.median(stated_m):.2f}; {draws - len(errors)})"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=300)
    draws = parser.parse_args().draws
    print("| points | on the floor only | a third of them 2 m high |\n|---|---|---|")
    for n in POINTS:
        print(f"| {n} | {cell(n, False, draws)} | {cell(n, True, draws)} |", flush=True)


if __name__ == "__main__":
    main()
