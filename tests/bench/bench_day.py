"""Whether a day makes fusion slower or larger: 24 simulated hours of views, as fast as they go, on a file.

    python -m tests.bench.bench_day [--hours 24] [--cameras 8] [--false 0.1]

A robot patrols a storey and looks every 20 s; each camera sends a changed picture every two minutes. Both see the same three
things, which stand elsewhere every three hours, with noise of their own and with false detections. Views are logged, integrated
and snapshotted as in the running service. Prints a row per three hours: the time of a view, the process's memory, and what the
file takes. With many false detections (``--false 8 --hours 1.5 --row 0.25``) the floor soon has as many objects as it may.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.perceived import PerceivedView
from tests.fusion_run import RANGE_M, FakeNode, perceived_view
from tests.measured_processes import memory_mib
from tests.world import World

_LENS = Pinhole.from_hfov(160, 120, math.radians(90))
_SIZE_M = (18.0, 12.0, 2.8)
_ROBOT_S, _CAMERA_S, _MOVED_S = 20.0, 120.0, 3 * 3600.0
_LABELS = ("couch", "desk", "bed")  # of a size that boxes of 1.6 m may have


class Storey:
    """A room of 18 x 12 m with three boxes, which stand elsewhere every three hours."""

    def __init__(self, seed: int, false_per_view: float) -> None:
        self._false_per_view = false_per_view
        self._rng = np.random.default_rng(seed)
        self._embeddings = np.eye(8, 64, dtype=np.float32)

    def view(self, source: str, seq: int, at_s: float, pose: tuple[float, float, float, float, float]) -> PerceivedView:
        """What a source at (x, y, height [m], yaw, pitch [rad]) sees and finds ``at_s`` seconds after the beginning."""
        x, y, height_m, yaw, pitch = pose
        T = camera_pose((x, y, height_m), yaw, pitch)
        depth_m, shown = self._world(int(at_s // _MOVED_S)).depth(T, _LENS)
        depth_m = depth_m * (1 + 0.005 * self._rng.standard_normal(depth_m.shape)).astype(np.float32)
        rgb = np.repeat((60 * (shown + 2) % 256).astype(np.uint8)[..., None], 3, axis=-1)
        view = PosedView(source, 0, seq, int(1e9 * (1 + at_s)), "0", T, _LENS, height_m, rgb, depth_m, RANGE_M)
        digest = seq.to_bytes(8, "big") + source.encode()[-8:].rjust(8)
        return perceived_view(view, ViewPerception("b", self._found(shown), self._embeddings[3]), digest)

    def _world(self, period: int) -> World:
        """The room with the boxes where they stand in a period of three hours."""
        rng = np.random.default_rng(1000 + period)
        places = [(x + rng.uniform(0, 2), rng.uniform(1, 9)) for x in (2.0, 8.0, 13.0)]
        boxes = {label: ((x, y, 0.0), (x + 1.6, y + 0.9, 0.8)) for label, (x, y) in zip(_LABELS, places, strict=True)}
        return World(((0.0, 0.0, 0.0), _SIZE_M), boxes)

    def _found(self, shown: np.ndarray) -> tuple[DetectedObject, ...]:
        found = []
        for k, label in enumerate(_LABELS):
            rows, cols = np.nonzero(shown == k)
            if len(rows) >= 40 and self._rng.random() < 0.8:
                box = float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1)
                found.append(DetectedObject(label, 0.6, box, None, self._embeddings[k]))
        for _ in range(int(self._false_per_view) + (self._rng.random() < self._false_per_view % 1)):
            x, y = self._rng.uniform(10, 100, 2).tolist()
            label = str(self._rng.choice(["tv", "toilet", "chair"]))
            found.append(DetectedObject(label, 0.35, (x, y * 0.7, x + 40, y * 0.7 + 30), None, self._embeddings[5]))
        return tuple(found)


def views(hours: float, n_cameras: int, false_per_view: float = 0.1) -> Iterator[tuple[float, PerceivedView]]:
    """All views of the time, in order, with their time [s]."""
    storey, seqs = Storey(0, false_per_view), dict[str, int]()
    places = [
        (0.3 + 17.4 * (k % 4) / 3, 0.3 if k < 4 else 11.7, 2.4, math.pi / 2 if k < 4 else -math.pi / 2, -0.5)
        for k in range(n_cameras)
    ]
    events = [(k * _ROBOT_S, "robot/r") for k in range(round(hours * 3600 / _ROBOT_S))]
    events += [
        (k * _CAMERA_S + 7.0 * c, f"camera/c{c}")
        for c in range(n_cameras)
        for k in range(round(hours * 3600 / _CAMERA_S))
    ]
    for at_s, source in sorted(events):
        seq = seqs[source] = seqs.get(source, 0) + 1
        if source.startswith("camera/"):
            yield at_s, storey.view(source, seq, at_s, places[int(source[8:])])
        else:
            t = seq * 0.02
            yield (
                at_s,
                storey.view(source, seq, at_s, (9 + 7 * math.cos(t), 6 + 4.5 * math.sin(t), 0.88, 0.7 * seq, -0.2)),
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--false", type=float, default=0.1, help="false detections of a view, on average")
    parser.add_argument("--row", type=float, default=3.0, help="hours of a row")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        settings = FusionSettings(store=f"{folder}/fusion.sqlite")
        maps = BuildingMaps(settings.core())
        log = MapLog(FakeNode(), settings, maps)  # type: ignore[arg-type]
        print(
            "| until hour | views | a view, median | 99 % | memory | file | objects | voxels | refused |\n"
            + "|---" * 9
            + "|"
        )
        times_s: list[float] = []
        n_refused, hour = 0, args.row
        for at_s, perceived in views(args.hours, args.cameras, args.false):
            if at_s >= 3600 * hour:
                print(_row(hour, times_s, maps.joint, folder, n_refused), flush=True)
                hour, times_s, n_refused = hour + args.row, [], 0
            began_s = time.thread_time()
            log.integrate([perceived])
            times_s.append(time.thread_time() - began_s)
            n_refused += bool(maps.processed.faults.get(perceived.key))
        print(_row(args.hours, times_s, maps.joint, folder, n_refused), flush=True)
        log.close()


def _row(hour: float, times_s: list[float], joint: JointMap, folder: str, n_refused: int) -> str:
    median, p99 = 1000 * np.percentile(times_s, [50, 99])
    file_mib = sum(f.stat().st_size for f in Path(folder).iterdir()) / 2**20
    voxels = sum(len(joint.layer(floor, "cloud")[1]) for floor in joint.floors)
    objects = sum(len(joint.object_ids(floor)) for floor in joint.floors)
    return (
        f"| {hour:g} | {len(times_s)} | {median:.1f} ms | {p99:.1f} ms | {memory_mib(os.getpid()):.0f} MiB | {file_mib:.0f} MiB "
        f"| {objects} | {voxels} | {n_refused} |"
    )


if __name__ == "__main__":
    main()
