"""What the joint maps cost, beside public implementations of the same steps.

``python -m pytest tests/bench/bench_fusion.py --benchmark-timer=time.process_time`` times each step; rows of one group
do the same work. ``python tests/bench/bench_fusion.py [views]`` prints the tables of docs/results/core.md, with CPU
times taken in turns so that their ratios hold on a busy machine, and a run of 5,000 views.

The world: rooms of 12 x 4 m in a row, analytic depth with noise of 0.5 %, 640 x 480 pixels, a robot that walks through
them and turns; detections are given (three boxes a view).
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import open3d as o3d
import pytest
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception
from surveilnav.services.fusion.core import JointMap, MapConfig
from surveilnav.services.fusion.core.maps.cloud import VoxelCloud
from surveilnav.services.fusion.core.maps.counting import count_points
from surveilnav.services.fusion.core.maps.floor_map import window_around
from surveilnav.services.fusion.core.maps.projection import world_points
from surveilnav.services.fusion.core.objects.clustering import dbscan

ROOM_M, ROOMS, LAPS = 12.0, 4, 5
CAMERA = Pinhole.from_hfov(640, 480, math.radians(79))
BOXES = [(20.0, 250.0, 180.0, 400.0), (250.0, 200.0, 400.0, 380.0), (430.0, 260.0, 630.0, 470.0)]


class Corridor:
    """Views of the rooms, each with noise of its own."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self._clean: dict[int, PosedView] = {}
        self._noise = (1 + 0.005 * self._rng.standard_normal(2 * 640 * 480)).astype(np.float32)
        e = self._rng.standard_normal((5, 512)).astype(np.float32)
        self.embeddings = e / np.linalg.norm(e, axis=1, keepdims=True)
        found = tuple(DetectedObject("chair", 0.7, b, None, v) for b, v in zip(BOXES, self.embeddings, strict=False))
        self.perceptions = {"no objects": (), "three objects": found}

    def view(self, seq: int, room: int) -> PosedView:
        """View ``seq``, in a room."""
        k = seq % 24
        if k not in self._clean:
            self._clean[k] = clean_view(6.0 + (k % 7) * 0.1, k * math.radians(30))
        clean = self._clean[k]
        shift = int(self._rng.integers(640 * 480))
        noise = self._noise[shift : shift + 640 * 480].reshape(480, 640)
        T = clean.T_world_camera.copy()
        T[0, 3] += ROOM_M * room
        return replace(clean, seq=seq, stamp_ns=seq, T_world_camera=T, depth_m=clean.depth_m * noise)

    def perception(self, what: str) -> ViewPerception:
        return ViewPerception("none", self.perceptions[what], self.embeddings[3])


def clean_view(x_m: float, yaw_rad: float) -> PosedView:
    """A room of 12 x 4 x 2.5 m from inside."""
    T = camera_pose((x_m, 2.0, 0.88), yaw_rad, 0.0)
    rays = CAMERA.rays() @ T[:3, :3].T.astype(np.float32)
    low, high = np.zeros(3, np.float32), np.array([ROOM_M, 4.0, 2.5], np.float32)
    with np.errstate(divide="ignore"):
        t = np.where(rays > 0, (high - T[:3, 3]) / rays, (low - T[:3, 3]) / rays).astype(np.float32)
    rgb = np.full((480, 640, 3), 128, np.uint8)
    return PosedView("robot/r", 0, 0, 0, "0", T, CAMERA, 0.88, rgb, t.min(axis=-1), (0.5, 5.0))


# --- the same step by others -------------------------------------------------------------------------------------------


@dataclass
class Accumulated:
    """A cloud of about 200,000 voxels, and the points of one view more."""

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]
    p_camera: NDArray[np.float64]
    cloud: VoxelCloud
    open3d: o3d.geometry.PointCloud

    @classmethod
    def make(cls) -> Accumulated:
        corridor, config = Corridor(), MapConfig()
        cloud = VoxelCloud(config)
        for seq in range(72):
            view = corridor.view(seq, 0)
            points, colours = world_points(view, config.points_per_view, 5.0, config.depth_edge)
            cloud.add(points, colours, view.T_world_camera[:3, 3].copy(), "robot/r", seq)
        array = cloud.array().astype(np.float64)
        pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(array[:, :3]))
        pcd.colors = o3d.utility.Vector3dVector(array[:, 3:])
        return cls(points, colours, view.T_world_camera[:3, 3].copy(), cloud, pcd)

    def ours(self) -> None:
        self.cloud.add(self.points, self.colours, self.p_camera, "robot/r", 100)

    def by_open3d(self) -> None:
        new = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self.points.astype(np.float64)))
        new.colors = o3d.utility.Vector3dVector(self.colours / 255.0)
        (self.open3d + new).voxel_down_sample(0.025)

    def by_numpy(self) -> None:
        """The new points joined to the old voxels by their sorted keys."""
        array = self.cloud_array
        points = np.concatenate([array[:, :3], self.points])
        colours = np.concatenate([array[:, 3:], self.colours / np.float32(255)])
        i = np.floor(points.astype(np.float64) / 0.025).astype(np.int64) + (1 << 20)
        _, inverse, counts = np.unique(
            (i[:, 2] << 42) | (i[:, 1] << 21) | i[:, 0], return_inverse=True, return_counts=True
        )
        for values in (points, colours):
            for k in range(3):
                np.bincount(inverse, values[:, k]) / counts

    @property
    def cloud_array(self) -> NDArray[np.float32]:
        if not hasattr(self, "_array"):
            self._array = self.cloud.array()
        return self._array


def mask_points(n: int) -> NDArray[np.float32]:
    """A chair of 0.5 m and the wall behind it, as a mask shows them."""
    rng = np.random.default_rng(0)
    chair = rng.uniform((-0.25, -0.25, 2.0), (0.25, 0.25, 2.4), (n * 3 // 4, 3))
    wall = rng.uniform((-0.4, -0.4, 3.2), (0.4, 0.4, 3.22), (n - len(chair), 3))
    return np.concatenate([chair, wall]).astype(np.float32)


def clusterings(n: int) -> dict[str, Callable[[], object]]:
    """DBSCAN with eps 0.05 m and 10 points (the paper's) of a mask's points."""
    points = mask_points(n)
    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    sk = DBSCAN(eps=0.05, min_samples=10)
    return {
        "ours": lambda: dbscan(points, 0.05, 10),
        "Open3D": lambda: pcd.cluster_dbscan(0.05, 10),
        "scikit-learn": lambda: sk.fit_predict(points),
    }


class Projection:
    """A view's points counted into the cells of the obstacle map."""

    def __init__(self) -> None:
        c = self.config = MapConfig()
        view = Corridor().view(0, 0)
        self.points, _ = world_points(view, c.points_per_view, 5.0, c.depth_edge)
        self.p_camera = view.T_world_camera[:3, 3].copy()
        self.window = window_around(self.points, self.p_camera, c.robot_radius_m, c.resolution_m)
        self.counts = [np.zeros(self.window[2:], np.uint32) for _ in range(8)]
        self.drops = [np.zeros(self.window[2:], np.uint32) for _ in range(2)]  # a corridor has none
        self.seen = np.full(self.window[2:], -1, np.int16)

    def ours(self) -> None:
        c = self.config
        count_points(
            self.points,
            self.p_camera,
            0.0,
            c.resolution_m,
            *self.window[:2],
            self.seen.copy(),
            np.inf,
            c.obstacle_min_m,
            c.obstacle_max_m,
            c.drop_min_m,
            c.obstacle_noise_per_m,
            c.explored_max_m,
            *self.counts[:2],
            *self.drops,
            *self.counts[2:4],
        )

    def by_numpy(self) -> None:
        c, p, (row0, col0, rows, cols) = self.config, self.points, self.window
        at = np.floor(p[:, 1].astype(np.float64) / c.resolution_m).astype(np.int64) - row0
        at = at * cols + np.floor(p[:, 0].astype(np.float64) / c.resolution_m).astype(np.int64) - col0
        squared = (p[:, 0] - self.p_camera[0]) ** 2 + (p[:, 1] - self.p_camera[1]) ** 2
        high = (c.obstacle_min_m + c.obstacle_noise_per_m * squared <= p[:, 2]) & (p[:, 2] <= c.obstacle_max_m)
        blocks = np.bincount(at[high], minlength=rows * cols).reshape(rows, cols)
        bare = np.bincount(at[~high & (abs(p[:, 2]) <= 0.08)], minlength=rows * cols).reshape(rows, cols) > 0
        seen = np.bincount(at[p[:, 2] <= c.explored_max_m], minlength=rows * cols).reshape(rows, cols) > 0
        for counts, new in zip(self.counts[4:], (blocks, blocks > 0, bare & (blocks == 0), seen), strict=True):
            counts += new.astype(np.uint32)


def comparisons() -> Iterator[tuple[str, dict[str, Callable[[], object]]]]:
    """Every step that somebody else does, too: name, and the ways to do it."""
    accumulated = Accumulated.make()
    yield (
        f"a view's points into a cloud of {accumulated.cloud.size:,} voxels",
        {
            "ours": accumulated.ours,
            "Open3D voxel_down_sample": accumulated.by_open3d,
            "numpy unique": accumulated.by_numpy,
        },
    )
    yield "DBSCAN of a mask of 1,000 points", clusterings(1000)
    yield "DBSCAN of a mask of 5,000 points", clusterings(5000)
    projection = Projection()
    yield "obstacle counts of a view", {"ours": projection.ours, "numpy": projection.by_numpy}


# --- pytest-benchmark ---------------------------------------------------------------------------------------------------


@pytest.mark.benchmark(group="view integration")
@pytest.mark.parametrize("what", ["no objects", "three objects"])
def test_view(benchmark, what):
    corridor, joint = Corridor(), JointMap()
    joint.integrate(corridor.view(0, 0), corridor.perception(what))
    joint.layer("0", "value", corridor.embeddings[0])
    perception, seq = corridor.perception(what), iter(range(1, 10**9))

    def setup():
        n = next(seq)
        return (corridor.view(n, n // 75), perception), {}

    done = benchmark.pedantic(joint.integrate, setup=setup, rounds=300, warmup_rounds=10)
    times_s = benchmark.stats.stats.data
    benchmark.extra_info |= {
        "p99_ms": round(1e3 * float(np.percentile(times_s, 99)), 2),
        "views_per_s": round(1 / float(np.median(times_s))),
    }
    assert done.n_points > 10_000


@pytest.fixture(scope="module")
def accumulated() -> Accumulated:
    return Accumulated.make()


@pytest.mark.benchmark(group="voxel insert")
@pytest.mark.parametrize("by", ["ours", "by_open3d", "by_numpy"])
def test_voxel_insert(benchmark, accumulated, by):
    benchmark(getattr(accumulated, by))


@pytest.mark.parametrize("n", [1000, 5000])
@pytest.mark.parametrize("by", ["ours", "Open3D", "scikit-learn"])
def test_dbscan(benchmark, n, by):
    benchmark.group = f"DBSCAN of {n} points"
    labels = np.asarray(benchmark(clusterings(n)[by]))
    assert labels.max() >= 1


@pytest.mark.benchmark(group="obstacle counts")
def test_obstacles_ours(benchmark):
    projection = Projection()
    benchmark(projection.ours)
    ours = [counts.copy() for counts in projection.counts[:4]]
    for counts in projection.counts[:4]:
        counts[:] = 0
    projection.ours()
    projection.by_numpy()
    for mine, theirs in zip(projection.counts[:4], projection.counts[4:], strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert ours[0].sum() > 1000
    assert not any(drops.any() for drops in projection.drops)


@pytest.mark.benchmark(group="obstacle counts")
def test_obstacles_numpy(benchmark):
    benchmark(Projection().by_numpy)


# --- the tables of docs/results/core.md ---------------------------------------------------------------------------------


def in_turns(ways: dict[str, Callable[[], object]], rounds: int = 25) -> dict[str, list[float]]:
    """CPU milliseconds of each way, one after the other in every round."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    for k in range(rounds + 2):
        for name, way in ways.items():
            start = time.process_time()
            way()
            if k >= 2:
                times[name].append(1e3 * (time.process_time() - start))
    return times


def resident_mb() -> float:
    """Memory that this process holds now."""
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def long_run(what: str, n: int) -> str:
    """``n`` views: laps through all rooms; memory after the first lap and at the end. Returns a line of a table."""
    corridor, joint = Corridor(), JointMap()
    joint.integrate(corridor.view(0, 0), corridor.perception(what))
    joint.layer("0", "value", corridor.embeddings[0])
    perception, cpu, warm_mb = corridor.perception(what), [], 0.0
    for seq in range(1, n + 1):
        view = corridor.view(seq, (seq - 1) * ROOMS * LAPS // n % ROOMS)
        start = time.process_time()
        joint.integrate(view, perception)
        cpu.append(1e3 * (time.process_time() - start))
        if seq == n // LAPS:
            warm_mb = resident_mb()
    k = min(100, n // 4)
    first, last, end_mb = float(np.median(cpu[:k])), float(np.median(cpu[-k:])), resident_mb()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    size = len(joint.layer("0", "cloud")[1])
    return (
        f"| {what} | {np.median(cpu):.1f} | {np.percentile(cpu, 99):.1f} | {1e3 / np.median(cpu):.0f} | {first:.1f} "
        f"| {last:.1f} | {last / first:.2f} | {warm_mb:.0f} | {end_mb:.0f} | {end_mb / warm_mb - 1:+.1%} | {peak_mb:.0f} "
        f"| {size:,} |"
    )


def main() -> None:
    if len(sys.argv) == 3:  # in a process of its own, so that memory is its own
        print(long_run(sys.argv[2], int(sys.argv[1])), flush=True)
        return
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
    print("## Fusion\n\n### Steps beside public implementations\n")
    print("CPU time in turns in one process; the median of each, and the ratio of the medians.\n")
    print("| step | by | median ms | ratio to ours |\n|---|---|---|---|", flush=True)
    for step, ways in comparisons():
        times = in_turns(ways)
        for name, ms in times.items():
            print(f"| {step} | {name} | {np.median(ms):.2f} | {np.median(ms) / np.median(times['ours']):.1f} |")
    print(f"\n### {n:,} views\n")
    print(
        f"{ROOMS} rooms of 12 x 4 m, {LAPS} laps. CPU time is that of `JointMap.integrate`: cloud, carving,\n"
        "obstacle and exploration map, value layer of one target, objects. Memory is the process's resident memory, after\n"
        "the first lap and at the end.\n"
    )
    print(
        f"| detections | median ms | p99 ms | views/s | first {min(100, n // 4)} ms | last ms | last / first "
        "| MB after lap 1 | MB at the end | growth | peak MB | voxels |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for what in ("no objects", "three objects"):
        subprocess.run([sys.executable, __file__, str(n), what], check=True)


if __name__ == "__main__":
    main()
