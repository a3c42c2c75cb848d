"""Renders the views of a split's buildings into packs, one file per building. Files that are already there are kept.

python -m training.depth.make_views --out data/depth/train --views 40 [--light flat] [--vary 1] [--scenes 0::4]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from surveilnav.benchmark.dataset.splits import SPLITS, SceneSpec
from surveilnav.config import cache_dir
from surveilnav.simulator.render.picture import Lighting
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from training.depth.pack import SUFFIX, write_pack
from training.depth.views import SIDE_PX, ViewSource
from training.detector.make_views import LIGHTS, parse_slice
from training.detector.variation import varied_scene


def make_pack(path: Path, spec: SceneSpec, light: Lighting, n: int, vary: int) -> str:
    """Writes ``n`` views of one building; returns a line for people. ``vary``: seed of other furniture, 0: none."""
    begun = time.perf_counter()
    scene = open_building(spec.building, seed=spec.seed, models=spec.models)
    navigation = NavigationMap.load_or_build(scene, cache_dir())
    source = ViewSource(varied_scene(scene, vary) if vary else scene, navigation, light)
    opened = time.perf_counter()
    size = write_pack(path, spec.scene, SIDE_PX, source.views(n, vary))
    each_ms = 1e3 * (time.perf_counter() - opened) / n
    return f"{spec.scene}: opened in {opened - begun:.1f} s; a view: {each_ms:.0f} ms, {size / n / 1e3:.0f} kB"


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.depth.make_views", description=__doc__.partition("\n")[0])
    parser.add_argument("--split", choices=sorted(SPLITS), default="train")
    parser.add_argument("--out", type=Path, required=True, help="a folder; its files are kept")
    parser.add_argument("--views", type=int, default=40, help="per building")
    parser.add_argument("--light", choices=LIGHTS, default="flat")
    parser.add_argument("--scenes", type=parse_slice, default=slice(None), help="some of the split's: START:STOP:STEP")
    parser.add_argument("--vary", type=int, default=0, help="other furniture and colours of this seed; 0: as they are")
    args = parser.parse_args(argv)
    specs = SPLITS[args.split].scenes[args.scenes]
    for number, spec in enumerate(specs, start=1):
        path = args.out / f"{spec.scene}{f'-v{args.vary}' if args.vary else ''}{SUFFIX}"
        if not path.exists():
            print(f"{number} of {len(specs)} {make_pack(path, spec, args.light, args.views, args.vary)}", flush=True)


if __name__ == "__main__":
    main()
