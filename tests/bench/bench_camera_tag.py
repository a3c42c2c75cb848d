"""How exact a camera's pose from a tag on a robot is, by number of stops: median and 90th percentile. Prints a table.

.venv/bin/python -m tests.bench.bench_camera_tag [--draws 120]
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from surveilnav.errors import PoseError
from tests.clicked_points import pose_error
from tests.tag_scenes import T_WORLD_CAMERA, random_stops, scene_from_poses

STOPS = (5, 10, 20)
#: Side of the tag [m] and standard deviation of its corners [px], as they are found in rendered pictures.
TAGS = ((0.16, 0.5), (0.30, 0.3))


def cell(n: int, size_m: float, sigma_px: float, wrong: bool, draws: int) -> str:
    """Errors of the poses that were found, and how many were refused. ``wrong``: at one stop the robot is 1 m off."""
    errors, stated_m = [], []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        scene = scene_from_poses(random_stops(rng, n, size_m=size_m), size_m=size_m).with_errors(rng, sigma_px)
        if wrong:
            scene.sightings.stops[0].x_m += 1.0
        try:
            camera = scene.solve().cameras["lobby"]
        except PoseError:
            continue
        error = pose_error(camera.T_world_camera, T_WORLD_CAMERA)
        errors.append((np.linalg.norm(error[:3]), math.degrees(np.linalg.norm(error[3:]))))
        stated_m.append(camera.position_sigma_m)
    if not errors:
        return f"all {draws} refused"
    (m50, deg50), (m90, deg90) = np.percentile(errors, [50, 90], axis=0)
    numbers = f"{m50:.3f}, {deg50:.2f} / {m90:.3f}, {deg90:.2f}"
    return f"{numbers} (± {np.median(stated_m):.3f}; {draws - len(errors)})"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=120)
    draws = parser.parse_args().draws
    tags = [f"{100 * size_m:.0f} cm, {sigma_px} px" for size_m, sigma_px in TAGS]
    print(f"| stops | {' | '.join(tags)} | {tags[0]}, the robot 1 m off at one stop |\n|---|---|---|---|")
    for n in STOPS:
        cells = [cell(n, size_m, sigma_px, False, draws) for size_m, sigma_px in TAGS]
        print(f"| {n} | {' | '.join(cells)} | {cell(n, *TAGS[0], True, draws)} |", flush=True)


if __name__ == "__main__":
    main()
