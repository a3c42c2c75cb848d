"""Choosing the generated buildings of a split so that scenes, floors and cameras come out as wanted.

    python -m surveilnav.benchmark.dataset.choose

Measures candidates in the order of their seeds (kept in ``--out``, so it can be stopped) and prints the first set whose
sums are right: never by bending the rule of cameras.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.splits import VAL_HOMES, VAL_SEEDS, Models, SceneSpec
from surveilnav.benchmark.studies.rows import Rows
from surveilnav.errors import SurveilNavError


@dataclass(frozen=True, slots=True)
class Measured:
    """A building: its floors and the cameras that the rule gives it at one per 100 m2."""

    building: str
    floors: int
    cameras: int


def measure(building: str, seed: int, models: Models) -> Measured:
    """Opens a building and counts."""
    opened = open_scene(SceneSpec(building, seed, models), lighting="flat")
    return Measured(building, len(opened.navigation.floors), len(opened.plan_with(100.0).cameras))


def choose(candidates: Sequence[Measured], scenes: int, floors: int, cameras: int) -> list[Measured] | None:
    """``scenes`` of the candidates that together have so many floors and cameras, the earliest ones that do; None: none.

    A table over (scenes, floors, cameras) reached with the first n candidates, as for the subset sum problem.
    """
    start = (0, 0, 0)
    reached: dict[tuple[int, int, int], tuple[tuple[int, int, int], int] | None] = {start: None}
    for index, m in enumerate(candidates):
        for n, f, c in sorted(reached):
            to = (n + 1, f + m.floors, c + m.cameras)
            if to not in reached and to[0] <= scenes and to[1] <= floors and to[2] <= cameras:
                reached[to] = ((n, f, c), index)
        if (scenes, floors, cameras) in reached:
            return _picked(candidates, reached, (scenes, floors, cameras))
    return None


def _picked(
    candidates: Sequence[Measured],
    reached: dict[tuple[int, int, int], tuple[tuple[int, int, int], int] | None],
    at: tuple[int, int, int],
) -> list[Measured]:
    picked = []
    while (step := reached[at]) is not None:
        at, index = step
        picked.append(candidates[index])
    return picked[::-1]


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the buildings that together have what the paper's dataset has."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.dataset.choose", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--out", type=Path, default=Path("runs/choose.jsonl"))
    parser.add_argument("--each", type=int, default=24, help="candidates of each kind")
    parser.add_argument("--first", type=int, default=0, help="the first candidate's number")
    parser.add_argument("--models", default="val", choices=("val", "train"))
    parser.add_argument("--scenes", type=int, default=36)
    parser.add_argument("--floors", type=int, default=74)
    parser.add_argument("--cameras", type=int, default=206)
    options = parser.parse_args(argv)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = Rows(options.out, ("building",))
    known = {m["building"]: Measured(**m) for m in rows.load()}
    numbers = range(options.first, options.first + options.each)
    names = [f"{kind}_{n}" for n in numbers for kind in ("office", "flats")]
    for name in (*VAL_HOMES, *names):
        if name not in known:
            known[name] = measure(name, 0, options.models)
            rows.append(asdict(known[name]))
            print(known[name], file=sys.stderr, flush=True)
    homes = [known[h] for h in VAL_HOMES for _ in VAL_SEEDS]
    rest = (
        options.scenes - len(homes),
        options.floors - sum(m.floors for m in homes),
        options.cameras - sum(m.cameras for m in homes),
    )
    picked = choose([known[n] for n in names], *rest)
    if picked is None:
        print(f"no {rest[0]} of {len(names)} candidates have {rest[1]} floors and {rest[2]} cameras: more --each")
        return 1
    print(", ".join(f'"{m.building}"' for m in picked))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
