"""How exact the maps are that cameras make: where things are said to be, and where obstacles.

    python -m surveilnav.benchmark.studies.camera_maps data/objectnav --split val_mini

In each building, all views of all cameras are integrated, with true detections, so that only places can be wrong. An object's
error is the horizontal distance from its centre to that of the nearest thing of its class, among things of which a camera is
within 6 m. Obstacles are compared with those that the same views give with depth without noise: the chamfer distance is the mean
distance to the nearest obstacle of the other map, in both directions.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.load import SceneData, load_scene, scenes_of
from surveilnav.benchmark.runner.search import sight_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.services.fusion.core import JointMap
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.truth.choose import choose_backend

#: What cameras know of depth and of their own pose. Errors of pose are the medians of poses from ten and from six clicks.
ARMS: Mapping[str, RunSettings] = {
    "depth sensor": RunSettings(),
    "our depth network": RunSettings(camera_depth="network"),
    "network, pose from 10 clicks": RunSettings(camera_depth="network", camera_error_m=0.04, camera_error_deg=0.34),
    "network, pose from 6 clicks": RunSettings(camera_depth="network", camera_error_m=0.07, camera_error_deg=0.51),
    "wrong by 5 % and 4 %": RunSettings(camera_depth="estimate-5"),
    "wrong by 15 % and 6 %": RunSettings(camera_depth="estimate-15"),
    "floor contact": RunSettings(camera_depth="none"),
}
_NEAR_M = 6.0
#: An object farther than this from every thing of its class is counted as a ghost, and not as an error of place.
_GHOST_M = 2.0


@dataclass
class Measured:
    """What came of an arm: errors [m] of objects, ghosts, things that no object stands for, chamfer distances [m]."""

    errors_m: list[float] = field(default_factory=list)
    n_ghosts: int = 0
    n_things: int = 0
    n_found: int = 0
    ghost_walls_m: list[float] = field(default_factory=list)
    missing_walls_m: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        median, p90 = np.percentile(self.errors_m, [50, 90]) if self.errors_m else (math.nan, math.nan)
        walls = "–"
        if self.ghost_walls_m:
            walls = f"{np.mean(self.ghost_walls_m):.2f} m | {np.mean(self.missing_walls_m):.2f} m"
        found = self.n_found / max(1, self.n_things)
        return f"| {name} | {median:.2f} m | {p90:.2f} m | {found:.0%} | {self.n_ghosts} | {walls} |"


def fused(data: SceneData, building: SimulatedBuilding, settings: RunSettings) -> JointMap:
    """The maps of all views of all cameras."""
    sight = sight_of(building, choose_backend("oracle"), settings, plan=data.plan(settings.density_m2))
    joint = JointMap(settings.fusion_config())
    for info in sight.infos:
        for seen in sight.camera(info.camera):
            joint.integrate(seen.view, seen.perception)
    return joint


def compare_objects(joint: JointMap, data: SceneData, building: SimulatedBuilding, into: Measured) -> None:
    """Adds the errors of the objects near cameras."""
    cameras = defaultdict(list)
    for camera in data.plan(RunSettings().density_m2).cameras:
        cameras[camera.floor].append(camera.position_m[:2])
    labels = building.scene.truth_labels
    for floor in joint.floors:
        if not cameras[floor]:
            continue
        things = defaultdict(list)
        for thing in building.scene.instances:
            centre = (np.asarray(thing.p_min) + np.asarray(thing.p_max))[:2] / 2
            near = np.linalg.norm(np.array(cameras[floor]) - centre, axis=1).min() <= _NEAR_M
            if near and thing.id in labels and building.scene.floor_at(float(thing.p_min[2])).id == floor:
                things[labels[thing.id]].append(centre)
        objects = [o for o in joint.objects(floor) if o.status != "rejected"]
        for o in objects:
            centre = np.array(o.center_m[:2])
            if np.linalg.norm(np.array(cameras[floor]) - centre, axis=1).min() > _NEAR_M:
                continue
            distance_m = min((float(np.linalg.norm(centre - t)) for t in things[o.label]), default=math.inf)
            if distance_m <= _GHOST_M:
                into.errors_m.append(distance_m)
            else:
                into.n_ghosts += 1
        for label, centres in things.items():
            of_label = [np.array(o.center_m[:2]) for o in objects if o.label == label]
            into.n_things += len(centres)
            into.n_found += sum(any(np.linalg.norm(c - p) <= 1.0 for p in of_label) for c in centres)


def compare_obstacles(joint: JointMap, exact: JointMap, into: Measured) -> None:
    """Adds the distances of obstacles from those of the exact map, and the other way round."""
    for floor in exact.floors:
        if floor not in joint.floors:
            continue
        (grid, ours), (_, truth) = joint.layer(floor, "occupancy"), exact.layer(floor, "occupancy")
        if ours.shape != truth.shape or not (ours.any() and truth.any()):
            continue
        into.ghost_walls_m.append(_mean_distance_m(ours != 0, truth != 0, grid.resolution_m))
        into.missing_walls_m.append(_mean_distance_m(truth != 0, ours != 0, grid.resolution_m))


def _mean_distance_m(of: NDArray[np.bool_], to: NDArray[np.bool_], resolution_m: float) -> float:
    """The mean distance [m] from the cells ``of`` to the nearest cell ``to``."""
    distance = cv2.distanceTransform((~to).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float(distance[of].mean()) * resolution_m


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="the dataset")
    parser.add_argument("--split", default="val_mini")
    parser.add_argument("--scenes", type=int, help="only so many")
    args = parser.parse_args()
    measured = {name: Measured() for name in ARMS}
    scenes = scenes_of(args.root, args.split)[: args.scenes]
    for number, scene in enumerate(scenes, 1):
        began_s = time.monotonic()
        data = load_scene(args.root, args.split, scene)
        building = open_scene(data.record, lighting="flat")
        building.settings.depth_noise = False
        exact = fused(data, building, RunSettings())
        building.settings.depth_noise = True
        for name, arm in ARMS.items():
            joint = fused(data, building, arm)
            compare_objects(joint, data, building, measured[name])
            if arm.camera_depth != "none":
                compare_obstacles(joint, exact, measured[name])
        left_min = (len(scenes) - number) * (time.monotonic() - began_s) / 60
        print(f"{number} of {len(scenes)}: {scene}; about {left_min:.0f} min left", flush=True)
    print("\n| cameras | object's error, median | 90 % below | things found | ghosts | obstacles too many | missing |")
    print("|---|---|---|---|---|---|---|")
    for name, found in measured.items():
        print(found.row(name))


if __name__ == "__main__":
    main()
