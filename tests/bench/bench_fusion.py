"""Milliseconds per view of the joint maps: ``python tests/bench/bench_fusion.py [views]``.

Rooms in a row, analytic depth, a robot that walks through them and turns; detections are given (three boxes a view).
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from services.fusion.core import JointMap
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.sensing.views import Detected, PosedView, ViewPerception


def corridor_view(seq: int, x_m: float, yaw_rad: float, camera: Pinhole, rng: np.random.Generator) -> PosedView:
    """A corridor along x, 4 m wide, 2.5 m high, with a cross wall every 12 m (6 m around the robot)."""
    T = camera_pose((x_m, 2.0, 0.88), yaw_rad, 0.0)
    rays = camera.rays() @ T[:3, :3].T.astype(np.float32)
    low = np.array([math.floor(x_m / 12) * 12, 0.0, 0.0], np.float32)
    high = low + np.array([12.0, 4.0, 2.5], np.float32)
    with np.errstate(divide="ignore"):
        t = np.where(rays > 0, (high - T[:3, 3]) / rays, (low - T[:3, 3]) / rays).astype(np.float32)
    depth_m = t.min(axis=-1) * (1 + 0.005 * rng.standard_normal(rays.shape[:2]).astype(np.float32))
    rgb = np.full((*depth_m.shape, 3), 128, np.uint8)
    return PosedView("robot/r", 0, seq, seq, "0", T, camera, 0.88, rgb, depth_m, (0.5, 5.0))


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    camera = Pinhole.from_hfov(640, 480, math.radians(79))
    rng = np.random.default_rng(0)
    e = rng.standard_normal((4, 512)).astype(np.float32)
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    boxes = [(20.0, 250.0, 180.0, 400.0), (250.0, 200.0, 400.0, 380.0), (430.0, 260.0, 630.0, 470.0)]
    detections = tuple(Detected("chair", 0.7, b, None, v) for b, v in zip(boxes, e[:3], strict=True))
    bare, full = ViewPerception("none", (), e[3]), ViewPerception("none", detections, e[3])
    for name, perception in (("no objects", bare), ("three objects", full)):
        joint = JointMap()
        joint.integrate(corridor_view(n, 6.0, 0.0, camera, rng), perception)
        joint.layer("0", "value", e[0])
        views = [corridor_view(i, 6.0 + (i % 7) * 0.1, i * math.radians(30), camera, rng) for i in range(24)]
        cpu = []
        for i in range(n):
            view = views[i % 24]
            T = view.T_world_camera.copy()
            T[0, 3] += 12.0 * (i * 8 // n)  # eight rooms, one after the other
            moved = PosedView("robot/r", 0, i, i, "0", T, camera, 0.88, view.rgb, view.depth_m, view.depth_range_m)
            start = time.process_time()
            joint.integrate(moved, perception)
            cpu.append(1e3 * (time.process_time() - start))
        k = min(100, n // 4)
        first, last = np.median(cpu[:k]), np.median(cpu[-k:])
        print(
            f"{name:14s} median {np.median(cpu):5.1f} ms  p99 {np.percentile(cpu, 99):5.1f} ms  "
            f"first {k}: {first:.1f}, last {k}: {last:.1f} ms  voxels {joint._storeys['0'].geometry.cloud.size}"
        )
        for layer in ("occupancy", "explored", "frontier", "value", "cloud"):
            start = time.process_time()
            _, array = joint.layer("0", layer, e[0])
            print(f"  layer {layer:10s} {1e3 * (time.process_time() - start):5.1f} ms  {array.shape}")
        start = time.process_time()
        joint.layer("0", "value", e[1])
        print(f"  value, new target {1e3 * (time.process_time() - start):5.1f} ms  objects {len(joint.objects('0'))}")


if __name__ == "__main__":
    main()
