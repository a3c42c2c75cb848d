"""What a detector sees in rendered buildings: recall and precision by class, distance and size.

    python -m surveilnav.benchmark.studies.detectors --buildings parametric_flat parametric_house --seeds 2 3 --robot-views 30 \\
        [--camera-views 12] [--detectors yolox-nano picodet-s]

Robot views: 640 x 480, 79 degrees, 0.88 m above places where the robot can stand, level and 30 degrees down; camera
views: 1280 x 1280, 100 degrees, 1.8 m, -30 degrees, of the building's own camera plan. An object counts if it is of
one of the six usual targets and shows at least ``--min-pixels`` pixels; a detection is right if its class is the
object's and the boxes overlap by IoU 0.5. The error model of ``simulated`` comes from
``surveilnav.benchmark.studies.calibration.run``.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.config import cache_dir
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.perception.boxes import overlaps
from surveilnav.perception.presets import DEFAULT_DETECTORS, DEFAULT_LARGE_DETECTORS
from surveilnav.perception.vocabulary import COCO
from surveilnav.robot_body import CAMERA_HEIGHT_M
from surveilnav.sensing.views import DetectedObject, TrueInstances
from surveilnav.simulator.furniture.labels import TARGETS
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.truth.visible import VisibleThing, mask_within, visible_things
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster

ROBOT = Pinhole.from_hfov(640, 480, math.radians(79))
CAMERA = Pinhole.from_hfov(1280, 1280, math.radians(100))
RANGE_EDGES_M = (1.5, 3.0, 5.0)
SIDE_EDGES_PX = (32.0, 96.0)


@dataclass(frozen=True, slots=True, eq=False)
class RenderedView:
    """One rendered view and what it shows. ``kind``: "robot" or "camera"."""

    name: str
    kind: str
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: Pinhole
    truth: TrueInstances


def views_of(name: str, seed: int, n_robot: int, n_camera: int) -> Iterator[RenderedView]:
    """Test views of a building, the same for the same arguments."""
    scene = open_building(name, seed=seed)
    caster = RayCaster(scene)
    navigation = NavigationMap.build(scene, caster=caster)
    renderer = Renderer(scene, cache_dir=cache_dir())
    labels = scene.truth_labels
    rng = np.random.default_rng([seed, 77])
    floors = [floor for floor, area in navigation.robot_area.items() if area.any()]
    poses = []
    for i in range(n_robot):
        x, y, z = navigation.random_point(rng, floors[i % len(floors)])
        pitch = -math.pi / 6 if i % 2 else 0.0
        poses.append(("robot", camera_pose((x, y, z + CAMERA_HEIGHT_M), rng.uniform(-math.pi, math.pi), pitch)))
    if n_camera:
        from surveilnav.simulator.world.cameras import place_cameras

        plan = [v for c in place_cameras(scene, navigation, caster=caster) for v in c.views[:12]]
        poses += [("camera", plan[i]) for i in rng.permutation(len(plan))[:n_camera]]
    for i, (kind, pose) in enumerate(poses):
        camera, far, noise = ROBOT, 5.0, DepthNoise.robot()
        if kind == "camera":
            camera, far, noise = CAMERA, 10.0, DepthNoise.camera()
        seen = renderer.render(pose, camera, depth_range_m=(0.3, far), noise=noise, seed=i)
        truth = TrueInstances(seen.instance_ids, labels)
        yield RenderedView(f"{name}-s{seed}-{i}", kind, seen.rgb, seen.depth_m, camera, truth)


def matches(things: Sequence[VisibleThing], found: Sequence[DetectedObject]) -> list[int]:
    """For every detection, best score first, the index of the thing whose box it fits best (IoU >= 0.5), or -1.

    A thing is given once, first to detections of its own class.
    """
    owner = [-1] * len(found)
    if not things or not found:
        return owner
    iou, _ = overlaps(np.array([d.box_px for d in found], np.float32), np.array([t.box_px for t in things], np.float32))
    free = set(range(len(things)))
    for same_class in (True, False):
        for i in sorted(range(len(found)), key=lambda i: -found[i].score):
            fits = [j for j in free if iou[i, j] >= 0.5 and (found[i].label == things[j].label) == same_class]
            if owner[i] < 0 and fits:
                owner[i] = max(fits, key=lambda j: iou[i, j])
                free.discard(owner[i])
    return owner


class Tally:
    """Counts of one kind of views at one lowest score."""

    def __init__(self, min_score: float, min_pixels: int) -> None:
        self.min_score, self.min_pixels = min_score, min_pixels
        self.views = 0
        self.objects: Counter[str] = Counter()
        self.hits: Counter[str] = Counter()
        self.false: Counter[str] = Counter()
        self.confused: Counter[tuple[str, str]] = Counter()
        self.cells: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
        self.true_scores: list[float] = []
        self.false_scores: list[float] = []
        self.mask_precision: list[float] = []
        self.mask_recall: list[float] = []

    def add(self, view: RenderedView, found: Sequence[DetectedObject]) -> None:
        """Counts a view and what was found in it."""
        self.views += 1
        everything = visible_things(view.truth, view.depth_m, 30, COCO)
        found = [d for d in found if d.score >= self.min_score and d.label in TARGETS]
        owner = matches(everything, found)
        hit = set()
        for d, j in zip(found, owner, strict=True):
            thing = everything[j] if j >= 0 else None
            if thing is not None and thing.label == d.label:
                hit.add(j)
                self.true_scores.append(d.score)
                self._add_mask(view, thing, d)
            else:
                self.false[d.label] += 1
                self.false_scores.append(d.score)
                self.confused[thing.label if thing else "background", d.label] += 1
        for j, thing in enumerate(everything):
            if thing.label in TARGETS and thing.n_pixels >= self.min_pixels:
                self.objects[thing.label] += 1
                self.hits[thing.label] += j in hit
                row = int(np.searchsorted(RANGE_EDGES_M, thing.range_m))
                col = int(np.searchsorted(SIDE_EDGES_PX, math.sqrt(thing.n_pixels)))
                self.cells[row, col].append(int(j in owner))

    def _add_mask(self, view: RenderedView, thing: VisibleThing, d: DetectedObject) -> None:
        if d.mask is None:
            return
        mask = mask_within(thing, d.box_px, view.depth_m.shape)
        both = float((mask & d.mask).sum())
        self.mask_precision.append(both / max(1.0, float(d.mask.sum())))
        self.mask_recall.append(both / max(1.0, float(mask.sum())))

    def lines(self) -> list[str]:
        """The counts, for people."""
        out = [f"{self.views} views, score >= {self.min_score:g}", "class          objects  recall  precision  false"]
        for label in (*TARGETS, "all"):
            n, h, f = ((sum(c.values()) if label == "all" else c[label]) for c in (self.objects, self.hits, self.false))
            right = len(self.true_scores) if label == "all" else h
            precision = right / (right + f) if right + f else math.nan
            out.append(f"{label:14} {n:7} {h / max(n, 1):7.2f} {precision:10.2f} {f:6}")
        out.append(
            "found, under whatever name, by distance (rows) and visible side in pixels (columns), objects in brackets:"
        )
        for row in range(len(RANGE_EDGES_M) + 1):
            cells = [self.cells[row, col] for col in range(len(SIDE_EDGES_PX) + 1)]
            out.append("  " + "  ".join(f"{np.mean(c) if c else math.nan:.2f} ({len(c)})" for c in cells))
        for least in (0.25, 0.35, 0.45, 0.55, 0.65):
            right, false = (sum(x >= least for x in scores) for scores in (self.true_scores, self.false_scores))
            share = right / max(1, right + false)
            out.append(
                f"score >= {least}: {right} right, precision {share:.2f}, {false / max(1, self.views):.2f} false a view"
            )
        wrong = ", ".join(f"{a}->{b} {n}" for (a, b), n in self.confused.most_common(8))
        out.append(f"wrong: {wrong}; {sum(self.false.values()) / max(1, self.views):.2f} per view")
        if self.mask_precision:
            out.append(f"masks: precision {np.mean(self.mask_precision):.2f}, recall {np.mean(self.mask_recall):.2f}")
        return out


def main(argv: Sequence[str] | None = None) -> None:
    """Prints what the detectors find."""
    parser = argparse.ArgumentParser(
        prog="surveilnav.benchmark.studies.detectors", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--buildings", nargs="+", required=True)
    parser.add_argument("--seeds", nargs="+", type=int, default=[2])
    parser.add_argument("--robot-views", type=int, default=30, help="per building and seed")
    parser.add_argument("--camera-views", type=int, default=0, help="per building and seed")
    parser.add_argument("--detectors", nargs="+", default=list(DEFAULT_DETECTORS))
    parser.add_argument("--large-detectors", nargs="+", default=list(DEFAULT_LARGE_DETECTORS))
    parser.add_argument("--min-pixels", type=int, default=400)
    args = parser.parse_args(argv)
    backend = choose_backend("onnx-coco", detectors=args.detectors, large_detectors=args.large_detectors)
    print(backend.why)
    tallies: dict[str, Tally] = {}
    times: defaultdict[str, list[float]] = defaultdict(list)
    for building in args.buildings:
        for seed in args.seeds:
            for view in views_of(building, seed, args.robot_views, args.camera_views):
                start = time.perf_counter()
                seen = backend.perceive(view.rgb, view.depth_m, view.camera)
                times[view.kind].append((time.perf_counter() - start) * 1e3)
                tallies.setdefault(view.kind, Tally(0.0, args.min_pixels)).add(view, seen.detections)
    for kind, tally in tallies.items():
        tally.min_score = min([*tally.true_scores, *tally.false_scores], default=0.0)
        print(f"## {kind}: {np.median(times[kind]):.0f} ms a view (one thread)")
        print("\n".join(tally.lines()), end="\n\n")


if __name__ == "__main__":
    main()
