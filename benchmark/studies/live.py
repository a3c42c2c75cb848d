"""What cameras change in the running system: ``surveilnav demo`` plays each search twice from the same start, with and without.

    python -m surveilnav.benchmark.studies.live --buildings office_200 flats_201 ... [--targets tv bed] [--seeds 0]
    python -m surveilnav.benchmark.studies.live --surveillance on ...    # with cameras alone: how often demo finds, by target

The searches run as users run them: all services, the bus, rendered pixels and the real clock, each with empty maps.
``demo`` renders light and views before it starts the services, so rendering takes none of a search's time. Camera
frames and perception's answers to them come from disk if an earlier search in the building asked for them. Each
search is a row of a file in ``--data``, so a second start plays only what is missing. The page goes to ``--page``.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from surveilnav.benchmark.canary import digest
from surveilnav.benchmark.runner.summary import Interval, interval
from surveilnav.benchmark.studies.arrivals import arrivals_of
from surveilnav.benchmark.studies.rows import RowsFile
from surveilnav.services.recorder.reading import RecordingError
from surveilnav.simulator.sources import TRAIN_HOMES
from surveilnav.simulator.world.labels import TARGETS

ARMS = ("on", "off")
KEY = ("building", "seed", "target", "surveillance")
_KEPT = (
    "success",
    "found",
    "error",
    "message",
    "steps",
    "spl",
    "path_m",
    "shortest_path_m",
    "search_s",
    "first_action_s",
    "perception",
    "cameras",
    "actions",
)
_LONGEST_S = 1200.0


class Search(NamedTuple):
    """One search to be played; the fields of ``KEY``."""

    building: str
    seed: int
    target: str
    surveillance: str


def play(search: Search, perception: str, runs: Path, models: str = "all") -> dict[str, Any]:
    """Plays a search and returns its row; a search that can't be played has the reason in "skipped".

    ``models``: which half of the furniture models the building is furnished with.
    """
    command = [
        str(Path(sys.executable).parent / "surveilnav"),
        "demo",
        "--json",
        "--building",
        search.building,
        "--seed",
        str(search.seed),
        "--target",
        search.target,
        "--surveillance",
        search.surveillance,
        "--perception",
        perception,
        "--runs",
        str(runs),
    ]
    recordings = runs / "recordings"
    before = set(recordings.glob("*.mcap"))
    try:
        ended = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=False,
            env=os.environ | {"SURVEILNAV_SIM__MODELS": models},
        )
        told = json.loads(ended.stdout.strip().splitlines()[-1])
    except (subprocess.TimeoutExpired, json.JSONDecodeError, IndexError) as error:
        return search._asdict() | {"skipped": f"{type(error).__name__}: see {runs}"}
    if "success" not in told:
        return search._asdict() | {"skipped": told.get("error", {}).get("message", "demo said nothing of a search")}
    row = search._asdict() | {name: told.get(name) for name in _KEPT} | {"program": digest(), "models": models}
    for recording in set(recordings.glob("*.mcap")) - before:
        with suppress(RecordingError):  # then the search can't be played with its timing
            row["arrivals"] = arrivals_of(recording).to_row()
    return row


# --- the page -----------------------------------------------------------------------------------------------------


Pair = tuple[dict[str, Any], dict[str, Any]]


def pairs_of(rows: Sequence[dict[str, Any]]) -> list[Pair]:
    """(with cameras, without) of every start that was played both ways."""
    played = {Search(*(r[k] for k in KEY)): r for r in rows if "skipped" not in r}
    return [
        (row, played[other])
        for search, row in sorted(played.items())
        if search.surveillance == "on" and (other := search._replace(surveillance="off")) in played
    ]


def page(rows: Sequence[dict[str, Any]], command: str) -> str:
    """The page in Markdown."""
    pairs, played = pairs_of(rows), [r for r in rows if "skipped" not in r]
    programs = ", ".join(sorted({r["program"] for r in played}))
    made = f"Made by `{command}`, program {programs}. {_fitted_to(played)}"
    if pairs:
        lines = [
            "# The running system, with cameras and without",
            "",
            *_in_words(pairs),
            "",
            made,
            "",
            *_table(pairs),
            "",
        ]
        lines += _every(pairs)
    elif played:
        lines = [
            "# The running system, search by search",
            "",
            *_how_often(played),
            "",
            made,
            "",
            *_by_target(played),
            "",
        ]
        lines += _each(played)
    else:
        lines = ["# The running system", "", "Nothing was played yet."]
    skipped = sorted({(r["building"], r["seed"], r["target"], r["skipped"]) for r in rows if "skipped" in r})
    if skipped:
        lines += ["", "## Not played", ""] + [
            f"- {b}, seed {s}, {t}: {why.partition(';')[0]}" for b, s, t, why in skipped
        ]
    return "\n".join([*lines, ""])


def _fitted_to(rows: Sequence[dict[str, Any]]) -> str:
    """Which plans and furniture models ``compact`` was trained on."""
    homes = [home for home in TRAIN_HOMES if any(r["building"] == home for r in rows)]
    plans = f"Training saw the plans of {', '.join(homes)}." if homes else "Training saw none of these plans."
    models = {r["models"] for r in rows}
    said = {"all": "training and held-out models", "train": "training models", "val": "held-out models"}
    return f"{plans} Furniture is of {' and of '.join(said[name] for name in sorted(models))}."


def _in_words(pairs: Sequence[Pair]) -> list[str]:
    scenes = [on["building"] for on, _ in pairs]
    spl = interval([100.0 * (on["spl"] - off["spl"]) for on, off in pairs], scenes)
    right = interval([100.0 * (on["success"] - off["success"]) for on, off in pairs], scenes)
    lines = [
        f"**{len(pairs)} starts in {len(set(scenes))} buildings, each played both ways.** Cameras change SPL by {_points(spl)}, "
        f"success by {_points(right)}."
    ]
    timed = [(on["search_s"], off["search_s"]) for on, off in pairs if on["search_s"] and off["search_s"]]
    if timed:
        ratio = statistics.median(on_s / off_s for on_s, off_s in timed)
        lines.append(
            f"By the clock a search with cameras takes {ratio:.2f} times as long as without (median of the ratios)."
        )
    lines.append(
        "Caches are warm: what cameras' views show is worked out in the first search of a building that asks for it."
    )
    first = [on["first_action_s"] for on, _ in pairs if on["first_action_s"] is not None]
    if first:
        lines.append(
            f"With cameras the first action comes {statistics.median(first):.1f} s after the mission was accepted, "
            f"{max(first):.1f} s at most."
        )
    return lines


def _how_often(rows: Sequence[dict[str, Any]]) -> list[str]:
    right, buildings = sum(r["success"] for r in rows), {(r["building"], r["seed"]) for r in rows}
    cameras = " and ".join(sorted({r["surveillance"] for r in rows}))
    return [
        f"**{right} of {len(rows)} searches end right ({100 * right / len(rows):.0f} %), SPL "
        f"{100 * statistics.mean(r['spl'] for r in rows):.1f}.** Buildings and seeds: "
        f"{len(buildings)}; cameras: {cameras}.",
        f"In {sum(bool(r['found']) for r in rows)} the robot said that it had found the target.",
    ]


def _by_target(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "| target | searches | right | SPL |"
    yield "|---|---|---|---|"
    for target in sorted({r["target"] for r in rows}):
        mine = [r for r in rows if r["target"] == target]
        spl = 100 * statistics.mean(r["spl"] for r in mine)
        yield f"| {target} | {len(mine)} | {sum(r['success'] for r in mine)} | {spl:.1f} |"


def _each(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "| building | seed | target | right | said | steps | way [m] | shortest [m] | time [s] |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for r in sorted(rows, key=lambda r: tuple(r[k] for k in KEY)):
        time_s = "–" if r["search_s"] is None else f"{r['search_s']:.1f}"
        said = "found" if r["found"] else r["error"] or "not found"
        yield (
            f"| {r['building']} | {r['seed']} | {r['target']} | {'yes' if r['success'] else 'no'} | {said} | {r['steps']} | "
            f"{r['path_m']:.1f} | {r['shortest_path_m']:.1f} | {time_s} |"
        )


def _points(value: Interval) -> str:
    return f"{value.mean:+.1f} [{value.low:+.1f}, {value.high:+.1f}]"


def _table(pairs: Sequence[Pair]) -> list[str]:
    lines = ["| cameras | success | SPL | way, median | time, median | steps, median |", "|---|---|---|---|---|---|"]
    for name, rows in zip(ARMS, zip(*pairs, strict=True), strict=True):
        times_s = [r["search_s"] for r in rows if r["search_s"]]
        lines.append(
            f"| {name} | {100 * statistics.mean(r['success'] for r in rows):.1f} % | "
            f"{100 * statistics.mean(r['spl'] for r in rows):.1f} | {statistics.median(r['path_m'] for r in rows):.1f} m | "
            f"{statistics.median(times_s) if times_s else float('nan'):.1f} s | "
            f"{statistics.median(r['steps'] for r in rows):.0f} |"
        )
    return lines


def _every(pairs: Sequence[Pair]) -> Iterator[str]:
    yield "| building | seed | target | success on / off | way [m] | shortest [m] | time [s] | first action [s] |"
    yield "|---|---|---|---|---|---|---|---|"
    for on, off in pairs:
        right = " / ".join("yes" if r["success"] else "no" for r in (on, off))
        yield (
            f"| {on['building']} | {on['seed']} | {on['target']} | {right} | {_both(on, off, 'path_m')} | "
            f"{on['shortest_path_m']:.1f} | {_both(on, off, 'search_s')} | {_both(on, off, 'first_action_s')} |"
        )


def _both(on: dict[str, Any], off: dict[str, Any], name: str) -> str:
    return " / ".join("–" if r[name] is None else f"{r[name]:.1f}" for r in (on, off))


# --- running ------------------------------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.live", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--buildings", nargs="+", required=True)
    parser.add_argument("--targets", nargs="+", default=list(TARGETS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--surveillance", nargs="+", choices=ARMS, default=list(ARMS))
    parser.add_argument("--models", choices=["all", "train", "val"], default="all", help="the half of furniture models")
    parser.add_argument("--perception", default="auto")
    parser.add_argument("--data", type=Path, default=Path("runs/live"))
    parser.add_argument("--page", type=Path, default=Path("docs/results/live.md"))
    parser.add_argument("--table", action="store_true", help="only write the page of what there is")
    return parser


def _command(parser: argparse.ArgumentParser, args: argparse.Namespace) -> str:
    """The command that plays this again."""
    words = [parser.prog]
    for name, value in vars(args).items():
        if name != "table" and value != parser.get_default(name):
            words += [
                f"--{name}",
                *(f'"{v}"' if " " in str(v) else str(v) for v in (value if isinstance(value, list) else [value])),
            ]
    return " ".join(words)


def main(argv: Sequence[str] | None = None) -> int:
    """Plays what is missing, one search after the other, and writes the page after each."""
    parser = _parser()
    args = parser.parse_args(argv)
    args.data.mkdir(parents=True, exist_ok=True)
    rows = RowsFile(args.data / f"{args.perception}{'' if args.models == 'all' else f'-{args.models}'}.jsonl", KEY)
    command = _command(parser, args)
    done = rows.done()
    missing = [
        search
        for building in args.buildings
        for seed in args.seeds
        for target in args.targets
        for arm in args.surveillance
        if (search := Search(building, seed, target, arm)) not in done
    ]
    began_s = time.monotonic()
    for number, search in enumerate([] if args.table else missing, start=1):
        row = play(search, args.perception, args.data / "runs", args.models)
        rows.append(row)
        args.page.write_text(page(rows.load(), command), encoding="utf-8")
        left_s = (time.monotonic() - began_s) / number * (len(missing) - number)
        said = row.get("skipped") or f"{'right' if row['success'] else 'wrong'} in {row['search_s']:.0f} s"
        print(
            f"{number} of {len(missing)} {' '.join(map(str, search))}: {said}; {left_s / 60:.0f} min left", flush=True
        )
    args.page.write_text(page(rows.load(), command), encoding="utf-8")
    return 0


if __name__ == "__main__":
    os.environ.setdefault("NO_COLOR", "1")
    sys.exit(main())
