"""What a picture costs: baked light beside unbaked, the z-buffer beside rays, the bake itself. Prints a table.

.venv/bin/python tests/bench/bench_render.py [--homes studio,3_bedroom] [--views 8] [--no-shadowed]
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from surveilnav.errors import SurveilNavError
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.sources import EXAMPLE_HOMES, open_building
from surveilnav.simulator.world.scene import Scene

ROBOT = Pinhole.from_hfov(640, 480, math.radians(79))
CAMERA = Pinhole.from_hfov(1280, 1280, math.radians(100))


def views_of(scene: Scene, count: int, height_m: float, pitch_rad: float) -> list[Matrix4]:
    """``count`` poses inside rooms, in turn, looking anywhere."""
    rng = np.random.default_rng(0)
    poses = []
    for k in range(count):
        room = scene.rooms[k % len(scene.rooms)]
        outline = np.array(room.polygon_m)
        x, y = outline.mean(axis=0) + rng.uniform(-0.2, 0.2, 2) * np.ptp(outline, axis=0)
        z = scene.floor(room.floor).z_m + height_m
        poses.append(camera_pose((x, y, z), rng.uniform(0, 2 * math.pi), pitch_rad))
    return poses


def median_ms(work: Callable[[Matrix4], object], poses: list[Matrix4]) -> float:
    """Median milliseconds of ``work`` over poses, after one call that isn't counted."""
    work(poses[0])
    times = []
    for pose in poses:
        begin = time.perf_counter()
        work(pose)
        times.append(1e3 * (time.perf_counter() - begin))
    return statistics.median(times)


def rays_ms(renderer: Renderer, camera: Pinhole, poses: list[Matrix4]) -> float:
    """Visibility by a ray per pixel, for comparison."""
    caster, rays = renderer.caster, camera.rays()
    return median_ms(lambda T: caster.cast(T[:3, 3].astype(np.float32), rays @ T[:3, :3].T.astype(np.float32)), poses)


def render_ms(renderer: Renderer, camera: Pinhole, poses: list[Matrix4], **options: Any) -> float:
    return median_ms(lambda T: renderer.render(T, camera, **options), poses)


def rows_of(home: str, views: int, with_shadowed: bool) -> Iterator[str]:
    """The table's rows for one home."""
    scene = open_building(home, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        Renderer(scene, cache_dir=Path(folder))
        bake_s = time.perf_counter() - begin
        begin = time.perf_counter()
        baked = Renderer(scene, cache_dir=Path(folder))
        open_s = time.perf_counter() - begin
    flat, shadowed = Renderer(scene, lighting="flat"), Renderer(scene, lighting="shadowed")
    for camera, height_m, pitch_rad in ((ROBOT, 0.88, 0.0), (CAMERA, 1.8, math.radians(-30))):
        poses = views_of(scene, views, height_m, pitch_rad)
        times = [
            render_ms(baked, camera, poses),
            render_ms(shadowed, camera, poses[:3]) if with_shadowed else math.nan,
            render_ms(flat, camera, poses),
            render_ms(baked, camera, poses, noise=DepthNoise.robot()),
            render_ms(baked, camera, poses, colors=False),
            rays_ms(flat, camera, poses),
        ]
        cells = [home, str(len(scene.triangles)), f"{bake_s:.1f}", f"{open_s:.1f}"]
        cells += [f"{camera.width_px}×{camera.height_px}", *(f"{t:.0f}" for t in times)]
        yield f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--homes", default="", help="names, comma-separated; default: the first and last example home")
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--no-shadowed", action="store_true", help="leave out the slow unbaked column")
    options = parser.parse_args()
    homes = [h for h in options.homes.split(",") if h] or [*EXAMPLE_HOMES[:1], *EXAMPLE_HOMES[-1:], "parametric_flat"]
    print(f"{os.cpu_count()} cores, median of {options.views} views in ms; load average {os.getloadavg()[0]:.1f}\n")
    columns = ["home", "triangles", "bake s", "open s", "picture", "baked", "unbaked", "flat", "noise", "no colours"]
    columns += ["z-buffer", "rays"]
    print(f"| {' | '.join(columns)} |")
    print("|---" * len(columns) + "|")
    for home in homes:
        try:
            for row in rows_of(home, options.views, not options.no_shadowed):
                print(row, flush=True)
        except SurveilNavError as error:
            print(f"| {home} | not opened: {error} |")


if __name__ == "__main__":
    main()
