"""From recorded states to rows of frontiers: what the model is given, and what is true.

    python -m training.places.rows --states data/places --out data/places_rows

A file for each building has these arrays; a row is a frontier of a state:

- ``features`` (n, k) as ``FrontierFeatures`` makes them
- ``left_m`` (n, targets) the true way from the frontier to the nearest viewpoint of each target; NaN: the building has none
- ``chance`` (n, targets) of the likeliest object on the floor to be the target; 2: one is confirmed
- ``state`` (n,) the number of the state; ``searched`` (n,) the number of the target that was searched
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core import MissionState, PlannerConfig
from surveilnav.services.planner.core.goals.frontiers import Frontier, find_frontiers
from surveilnav.services.planner.core.motion.terrain import build_terrain, coarse_travel_time_m
from surveilnav.services.planner.core.places.features import FrontierFeatures
from surveilnav.services.planner.core.places.model import best_chance
from surveilnav.simulator.world.labels import TARGETS
from training.places.states import State, TrueWays, read_states

#: The classes of objects that are looked at: COCO's that furnish rooms.
LABELS = ("bed", "couch", "chair", "toilet", "tv", "potted plant", "dining table", "sink", "oven", "refrigerator")
CONFIRMED = 2.0


def frontiers_of(state: State) -> list[Frontier]:
    """The frontiers that the planner finds in a state."""
    config = PlannerConfig()
    terrain = build_terrain(state.maps, state.robot, MissionState(state.searched, max_steps=500), config, [])
    travel_time_m = coarse_travel_time_m(terrain, state.robot.x_m, state.robot.y_m)
    return find_frontiers(state.maps, terrain, travel_time_m, config)


def rows_of(state: State, truth: TrueWays) -> dict[str, NDArray[np.float32]] | None:
    """The rows of a state (without ``state``); None if there is nothing to choose."""
    found = frontiers_of(state)
    if len(found) < 2:
        return None
    n, known = len(found), truth.categories()
    left_m = np.full((n, len(TARGETS)), np.nan, np.float32)
    chance = np.zeros((n, len(TARGETS)), np.float32)
    for i, target in enumerate(TARGETS):
        confirmed = any(o.status == "confirmed" and o.label == target for o in state.maps.objects)
        chance[:, i] = CONFIRMED if confirmed else best_chance(state.maps, target)
        if target in known:
            left_m[:, i] = [truth.left_m(target, state.maps.floor, f.x_m, f.y_m) for f in found]
    return {
        "features": FrontierFeatures(state.maps, (state.robot.x_m, state.robot.y_m), LABELS).of(found),
        "left_m": left_m,
        "chance": chance,
        "searched": np.full(n, TARGETS.index(state.searched), np.float32),
    }


def extract(folder: Path, out: Path) -> str:
    """Writes the rows of a building; a line for people."""
    path, began_s = out / f"{folder.name}.npz", time.monotonic()
    if path.is_file():
        return ""
    truth = TrueWays(folder / "truth.npz")
    found: list[dict[str, NDArray[np.float32]]] = []
    for search in sorted(p for p in folder.glob("*.npz") if p.name != "truth.npz"):
        for state in read_states(search):
            if (rows := rows_of(state, truth)) is not None:
                found.append({**rows, "state": np.full(len(rows["features"]), len(found), np.float32)})
    if not found:
        return f"{folder.name}: nothing to choose"
    whole: dict[str, Any] = {name: np.concatenate([rows[name] for rows in found]) for name in found[0]}
    np.savez_compressed(path, **whole)
    return f"{folder.name}: {len(found)} states, {time.monotonic() - began_s:.0f} s"


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--states", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    a = parser.parse_args(argv)
    a.out.mkdir(parents=True, exist_ok=True)
    folders = [p for p in sorted(a.states.iterdir()) if (p / "done").is_file()]
    with multiprocessing.get_context("spawn").Pool(a.workers) as pool:
        for line in pool.imap_unordered(partial(extract, out=a.out), folders):
            if line:
                print(line, flush=True)


if __name__ == "__main__":
    main()
