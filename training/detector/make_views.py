"""Renders the views of a split's buildings into packs, a file a building; what is there already is kept.

    python -m training.detector.make_views --split train --out data/views/train --robot 120 --camera 60 \\
        [--light baked] [--scenes 12::7] [--vary 1] [--quality 75]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

from surveilnav.benchmark.dataset.splits import SPLITS, SceneSpec
from surveilnav.config import cache_dir
from surveilnav.simulator.render.picture import Lighting
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from training.detector import classes
from training.detector.pack import SUFFIX, write_pack
from training.detector.poses import Kind
from training.detector.variation import varied_scene
from training.detector.views import TrainingView, ViewSource

LIGHTS: tuple[Lighting, ...] = ("baked", "shadowed", "flat")


def make_pack(
    spec: SceneSpec,
    light: Lighting,
    counts: dict[Kind, int],
    out: Path,
    quality: int,
    *,
    as_sensed: bool = False,
    vary: int = 0,
) -> str:
    """One building's file; returns what was made and what it cost, for people. ``vary``: seed of other furniture, 0: none."""
    names, timed = classes.load(), _Timed()
    scene = open_building(spec.building, seed=spec.seed, models=spec.models)
    navigation = NavigationMap.load_or_build(scene, cache_dir())
    source = ViewSource(varied_scene(scene, vary) if vary else scene, navigation, light, names, as_sensed=as_sensed)
    opened_s = timed.lap()
    views = chain.from_iterable(timed.views(source, kind, n, vary) for kind, n in counts.items())
    size = write_pack(pack_path(out, spec, vary), spec.scene, views, names.names, names.rooms, quality)
    each = ", ".join(f"{kind} {timed.ms[kind] / max(1, n):.0f} ms" for kind, n in counts.items())
    return f"{spec.scene}: {light}, opened in {opened_s:.1f} s; a view: {each}, {size / max(1, sum(counts.values())):.0f} bytes"


def pack_path(out: Path, spec: SceneSpec, vary: int) -> Path:
    """The file of a building's views."""
    return out / f"{spec.scene}{f'-v{vary}' if vary else ''}{SUFFIX}"


class _Timed:
    """Adds up what views of each kind took [ms]."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self.ms: dict[Kind, float] = {"robot": 0.0, "camera": 0.0}

    def lap(self) -> float:
        return time.perf_counter() - self._start

    def views(self, source: ViewSource, kind: Kind, n: int, seed: int) -> Iterator[TrainingView]:
        start = time.perf_counter()
        for view in source.views(kind, n, seed):
            self.ms[kind] += 1e3 * (time.perf_counter() - start)
            yield view
            start = time.perf_counter()


def parse_slice(text: str) -> slice:
    """ "12::7" as Python means it."""
    return slice(*(int(part) if part else None for part in text.split(":")))


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.detector.make_views", description=__doc__.partition("\n")[0])
    parser.add_argument("--split", choices=sorted(SPLITS), default="train")
    parser.add_argument("--out", type=Path, required=True, help="a folder; files that it holds are kept")
    parser.add_argument("--robot", type=int, default=120, help="views of robots per building")
    parser.add_argument("--camera", type=int, default=60, help="views of cameras per building")
    parser.add_argument("--light", choices=LIGHTS, default="baked")
    parser.add_argument("--scenes", type=parse_slice, default=slice(None), help="some of the split's: START:STOP:STEP")
    parser.add_argument("--vary", type=int, default=0, help="other furniture and colours of this seed; 0: as they are")
    parser.add_argument("--as-sensed", action="store_true", help="at the sensors' own size, for evaluation")
    parser.add_argument("--quality", type=int, default=75, help="of WebP")
    args = parser.parse_args(argv)
    specs = SPLITS[args.split].scenes[args.scenes]
    for done, spec in enumerate(specs, start=1):
        if pack_path(args.out, spec, args.vary).exists():
            continue
        counts: dict[Kind, int] = {"robot": args.robot, "camera": args.camera}
        said = make_pack(spec, args.light, counts, args.out, args.quality, as_sensed=args.as_sensed, vary=args.vary)
        print(f"{done} of {len(specs)} {said}", flush=True)


if __name__ == "__main__":
    main()
