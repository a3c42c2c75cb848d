"""Searches in buildings of which a map is known before, beside the same searches without it.

    python -m surveilnav.benchmark.studies.prior_map --searches 6

The map is what a robot's own mapping would have made of the building, as Nav2's map of each floor: walls, furniture and free
floor, from the simulator's map of where a robot can drive. ``--off`` misplaces it by so many metres, as a bad frame would.
The searches are those of the golden run, with our policy.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import mean, median

import numpy as np

from surveilnav.benchmark import canary
from surveilnav.benchmark.play.episode import EpisodeResult
from surveilnav.benchmark.runner.search import search, sight_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.robot_frame import Nav2Map, PlanarTransform
from surveilnav.robot_frame.nav2_map import FREE, OCCUPIED, UNKNOWN
from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.maps.prior import PriorMap
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.world.navigation import NavigationMap

ARMS = ("without a map", "with a map", "with a map, no cameras", "without both")


def priors_of(navigation: NavigationMap, off_m: float = 0.0) -> Mapping[str, PriorMap]:
    """By floor, the map that a robot would have of it. What has no roof is unknown, as beside the topic ``/map``."""
    priors = {}
    for name, floor in navigation.floors.items():
        cells = np.where(floor.obstacle, OCCUPIED, np.where(floor.supported & floor.indoor, FREE, UNKNOWN))
        T_map_cells = PlanarTransform(floor.grid.origin_x_m, floor.grid.origin_y_m)
        nav2_map = Nav2Map(cells.astype(np.uint8), floor.grid.resolution_m, T_map_cells)
        priors[name] = PriorMap(nav2_map, PlanarTransform(off_m))
    return priors


@dataclass
class Row:
    """What came of the searches of one arm."""

    results: list[EpisodeResult] = field(default_factory=list)

    def text(self, name: str) -> str:
        success, spl = (mean(getattr(r.verdict, what) for r in self.results) for what in ("success", "spl"))
        steps, path_m = median(r.steps for r in self.results), median(r.verdict.path_m for r in self.results)
        return f"| {name} | {success:.0%} | {spl:.3f} | {steps:.0f} | {path_m:.1f} m |"


HEADER = "| | success | SPL | steps, median | way, median |\n|---|---|---|---|---|"


def play(golden: canary.Search, n_cameras: int, arm: str, off_m: float) -> EpisodeResult:
    """Plays one search."""
    settings = RunSettings(surveillance=arm in ("without a map", "with a map"))
    building, goals, start = canary.open_search(golden, n_cameras)
    fusion: FusionConfig = settings.fusion_config()
    if arm.startswith("with a map"):
        fusion = fusion.model_copy(update={"map": fusion.map.with_priors(priors_of(building.navigation, off_m))})
    sight = sight_of(building, choose_backend("simulated"), settings)
    on_floor = start.floor in goals.viewpoints
    return search(sight, settings, goals, start, seed=1, goal_on_floor=on_floor, fusion=fusion)


def main() -> None:
    parser = argparse.ArgumentParser(prog="prior_map", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--searches", type=int, default=6)
    parser.add_argument("--skip", type=int, default=0, help="leave out so many of the first searches")
    parser.add_argument("--cameras", type=int, default=3, help="of each building")
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS), metavar="ARM")
    parser.add_argument("--off", type=float, default=0.0, help="the map lies so far beside its place [m]")
    args = parser.parse_args()
    searches = [s for s in canary.read().searches if s.did is not None][args.skip : args.skip + args.searches]
    rows = {arm: Row() for arm in args.arms}
    for golden in searches:
        for arm, row in rows.items():
            row.results.append(result := play(golden, args.cameras, arm, args.off))
            done = result.reason or "found"
            print(
                f"{golden.building}, {golden.target}, {arm}: {done}, {result.steps} steps, {result.verdict.path_m:.1f} m",
                flush=True,
            )
    print(f"\n{HEADER}")
    for name, row in rows.items():
        print(row.text(name))


if __name__ == "__main__":
    main()
