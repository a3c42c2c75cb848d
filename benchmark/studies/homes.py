"""The example homes' table: every home x every target in it x seeds, with and without surveillance.

    python -m surveilnav.benchmark.studies.homes --out docs/results/homes

Resumable: every finished episode is a line of ``episodes.jsonl``; a second start does only what is missing. The table
``README.md`` beside it is written anew after every episode, so it is there whenever one looks.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from surveilnav.benchmark.play.workers import in_workers
from surveilnav.benchmark.studies.rows import Rows
from surveilnav.errors import ConfigError, SurveilNavError, TargetError
from surveilnav.simulator.furniture.labels import TARGETS

if TYPE_CHECKING:
    from surveilnav.benchmark.play.sight import Sight

ARMS = ("on", "off")
KEY = ("building", "seed", "target", "surveillance")


@dataclass(frozen=True, slots=True)
class Job:
    """All episodes of one furnished home."""

    building: str
    seed: int
    targets: tuple[str, ...]
    arms: tuple[str, ...]
    perception: str
    cameras: int | None
    area_per_camera_m2: float
    max_steps: int


def run_job(job: Job, done: frozenset[tuple[Any, ...]], out: Path) -> int:
    """Runs what is missing of a job; returns how many episodes it ran."""
    from surveilnav.benchmark.play.sight import Sight
    from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
    from surveilnav.simulator.truth.choose import choose_backend

    missing = [(t, a) for t in job.targets for a in job.arms if (job.building, job.seed, t, a) not in done]
    if not missing:
        return 0
    backend = choose_backend(job.perception)
    building = SimulatedBuilding(
        SimulationSettings(
            building=job.building, seed=job.seed, cameras=job.cameras, area_per_camera_m2=job.area_per_camera_m2
        )
    )
    building.prepare()
    sight = Sight(building, backend)
    parent = os.getppid()
    for target, arm in missing:
        if os.getppid() != parent:
            return len(missing)  # whoever started this was killed: don't go on unseen
        facts: dict[str, Any] = {"building": job.building, "seed": job.seed, "target": target, "surveillance": arm}
        rows_in(out).append(facts | _searched(sight, job, target, arm))
    return len(missing)


def _searched(sight: Sight, job: Job, target: str, arm: str) -> dict[str, Any]:
    """What came of one search, or why it can't be."""
    from surveilnav.benchmark.runner.search import search
    from surveilnav.benchmark.runner.settings import RunSettings
    from surveilnav.simulator.world.goals import find_goals, sample_start

    building = sight.building
    try:
        goals = find_goals(building.scene, building.navigation, target, caster=building.caster)
        start = sample_start(building.scene, building.navigation, goals, seed=job.seed, caster=building.caster)
    except TargetError as error:
        return {"skipped": str(error)}
    settings = RunSettings(perception=job.perception, surveillance=arm == "on", max_steps=job.max_steps)
    episode = search(sight, settings, goals, start, seed=job.seed)
    verdict = episode.verdict
    return {
        "perception": sight.backend.name,
        "success": verdict.success,
        "found": episode.found,
        "reason": episode.reason,
        "message": episode.message,
        "steps": episode.steps,
        "spl": round(verdict.spl, 4),
        "soft_spl": round(verdict.soft_spl, 4),
        "path_m": round(verdict.path_m, 2),
        "shortest_path_m": round(verdict.shortest_path_m, 2),
        "distance_m": round(verdict.distance_to_viewpoint_m, 2) if verdict.distance_to_viewpoint_m < 1e6 else None,
        "success_at_0_2_m": verdict.success_at_0_2_m,
        "success_at_1_m": verdict.success_at_1_m,
        "cameras": len(sight.infos),
        "invoked": sorted(episode.camera_bytes),
        "robot_bytes": episode.robot_bytes,
        "camera_bytes": sum(episode.camera_bytes.values()),
        "start_notes": list(start.notes),
        "seconds": round(episode.seconds, 1),
    }


def rows_in(out: Path) -> Rows:
    """The searches of a table's folder."""
    return Rows(out / "episodes.jsonl", KEY)


# --- the table ----------------------------------------------------------------------------------------------------


def table(records: Sequence[dict[str, Any]], command: str) -> str:
    """docs/results/homes/README.md."""
    played = sorted((r for r in records if "skipped" not in r), key=_key_of)
    arms = {arm: [r for r in played if r["surveillance"] == arm] for arm in ARMS}
    lines = _about(played, command)
    lines += [_summary(f"surveillance {arm}", rows) for arm, rows in arms.items() if rows]
    for title, field in (("target", "target"), ("home", "building")):
        names = TARGETS if field == "target" else sorted({r["building"] for r in played})
        lines += ["", f"## By {title}", "", f"| {title} | on: success | on: SPL | off: success | off: SPL |"]
        lines += ["|---|---|---|---|---|"]
        lines += [_by(name, [[r for r in arms[arm] if r[field] == name] for arm in ARMS]) for name in names]
    lines += ["", "## Failures by reason", "", "| reason | on | off |", "|---|---|---|"]
    for reason in sorted({r["reason"] for r in played if r["reason"]}):
        counts = (str(sum(r["reason"] == reason for r in arms[a])) for a in ARMS)
        lines.append(f"| {reason} | " + " | ".join(counts) + " |")
    lines += ["", "## Every episode", "", "| " + " | ".join(_COLUMNS) + " |", "|" + "---|" * len(_COLUMNS)]
    lines += [_episode(rows) for rows in _paired(played)]
    skipped = sorted({(r["building"], r["seed"], r["skipped"]) for r in records if "skipped" in r})
    if skipped:
        lines += ["", "## Not played", ""] + [f"- {b}, seed {s}: {why}" for b, s, why in skipped]
    return "\n".join(lines) + "\n"


_COLUMNS = (
    "home",
    "seed",
    "target",
    "cameras",
    "success on / off",
    "steps",
    "path [m]",
    "shortest [m]",
    "MB",
    "why it failed",
)


def _about(played: Sequence[dict[str, Any]], command: str) -> list[str]:
    return [
        "# Nine example homes, with and without surveillance",
        "",
        f"Made by `{command}`; seeds {', '.join(str(s) for s in sorted({r['seed'] for r in played}))}. "
        f"Perception: {', '.join(sorted({r['perception'] for r in played}))} on rendered pixels; no "
        "ground truth in the loop. Success: `stop` within 0.1 m (geodesic) of a viewpoint (Habitat's rule). Starts: the "
        "target out of sight and at least 5 m of way off where the home allows it (`*` marks relaxed starts). The "
        "detectors' thresholds were chosen on six of these floor plans with other furniture (seeds 7 and 8). Robot and "
        "camera MB: bytes offered by the real encoders.",
        "",
        "| | episodes | success | at 0.2 m | at 1 m | SPL | steps (mean) | path (mean) | robot MB | camera MB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]


def _key_of(record: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(record[name] for name in KEY)


def _summary(name: str, rows: Sequence[dict[str, Any]]) -> str:
    n = len(rows)
    mean = {k: sum(r[k] for r in rows) / n for k in ("spl", "steps", "path_m", "robot_bytes", "camera_bytes")}
    rates = " | ".join(
        f"{100 * sum(r[k] for r in rows) / n:.1f} %" for k in ("success", "success_at_0_2_m", "success_at_1_m")
    )
    return (
        f"| {name} | {n} | {rates} | {100 * mean['spl']:.1f} | {mean['steps']:.0f} | {mean['path_m']:.1f} m "
        f"| {mean['robot_bytes'] / 1e6:.1f} | {mean['camera_bytes'] / 1e6:.1f} |"
    )


def _by(name: str, arms: Iterable[Sequence[dict[str, Any]]]) -> str:
    cells = [name]
    for rows in arms:
        if rows:
            cells += [
                f"{sum(r['success'] for r in rows)}/{len(rows)}",
                f"{100 * sum(r['spl'] for r in rows) / len(rows):.1f}",
            ]
        else:
            cells += ["-", "-"]
    return "| " + " | ".join(cells) + " |"


def _paired(played: Sequence[dict[str, Any]]) -> list[dict[str, dict[str, Any]]]:
    pairs: dict[tuple[str, int, str], dict[str, dict[str, Any]]] = {}
    for r in played:
        pairs.setdefault((r["building"], r["seed"], r["target"]), {})[r["surveillance"]] = r
    return list(pairs.values())


def _episode(pair: dict[str, dict[str, Any]]) -> str:
    one = next(iter(pair.values()))

    def both(value: Any) -> str:
        return " / ".join(value(pair[arm]) if arm in pair else "-" for arm in ARMS)

    reasons = "; ".join(
        f"{arm}: {r['reason']} ({r['message']})" for arm, r in sorted(pair.items(), reverse=True) if r["reason"]
    )
    cells = (
        one["building"],
        one["seed"],
        one["target"] + ("*" if one["start_notes"] else ""),
        one["cameras"],
        both(lambda r: "yes" if r["success"] else "no"),
        both(lambda r: str(r["steps"])),
        both(lambda r: f"{r['path_m']:.1f}"),
        f"{one['shortest_path_m']:.1f}",
        both(lambda r: f"{(r['robot_bytes'] + r['camera_bytes']) / 1e6:.0f}"),
        reasons,
    )
    return "| " + " | ".join(str(c).replace("|", "/") for c in cells) + " |"


def claim(options: argparse.Namespace) -> str:
    """Keeps the settings of a table beside it, so that a second start can't mix others in; returns the command.

    Raises:
        ConfigError: the folder holds episodes of other settings.
    """
    from surveilnav.benchmark.runner.settings import RunSettings

    asked = {name: getattr(options, name) for name in ("perception", "cameras", "area_per_camera", "max_steps")}
    settings = asked | {"views_per_step": RunSettings().views_per_step}
    path = options.out / "settings.json"
    known = json.loads(path.read_text()) if path.exists() else settings
    if known != settings:
        raise ConfigError(
            f"{options.out} holds episodes made with {known}, now asked for {settings}: take another --out"
        )
    path.write_text(json.dumps(settings, indent=2) + "\n")
    defaults: dict[str, Any] = {"perception": "onnx-coco", "cameras": None, "area_per_camera": 100.0, "max_steps": 500}
    more = [f"--{n.replace('_', '-')} {v}" for n, v in asked.items() if v != defaults[n]]
    return " ".join(["python -m surveilnav.benchmark.studies.homes", *more])


# --- running ------------------------------------------------------------------------------------------------------


def _work(arguments: tuple[Job, frozenset[tuple[Any, ...]], Path]) -> None:
    run_job(*arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Plays what is missing and writes the table; 1 if a home couldn't be played."""
    options = _parser().parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    command = claim(options)
    page, rows = options.out / "README.md", rows_in(options.out)
    if options.table:
        page.write_text(table(rows.load(), command))
        return 0
    jobs = [
        Job(
            b,
            s,
            tuple(options.targets),
            tuple(options.surveillance),
            options.perception,
            options.cameras,
            options.area_per_camera,
            options.max_steps,
        )
        for s in options.seeds
        for b in options.buildings
    ]
    total = len(jobs) * len(options.targets) * len(options.surveillance)
    done = rows.done()
    began_s, before, failed = time.monotonic(), len(rows.load()), 0
    for ended in in_workers(_work, [(job, done, options.out) for job in jobs], options.workers, 30.0):
        if ended is not None and ended.error:
            failed += 1
            job = ended.job[0]
            print(f"{job.building} seed {job.seed} could not be played: {ended.error}", file=sys.stderr)
        records = rows.load()
        page.write_text(table(records, command))
        new = len(records) - before
        left_s = (time.monotonic() - began_s) / max(1, new) * (total - len(records))
        print(f"{len(records)}/{total} episodes, about {left_s / 60:.0f} min left", file=sys.stderr, flush=True)
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    from surveilnav.simulator.sources import EXAMPLE_HOMES

    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.homes", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--out", type=Path, default=Path("docs/results/homes"))
    parser.add_argument("--buildings", nargs="*", default=list(EXAMPLE_HOMES))
    parser.add_argument("--targets", nargs="*", default=list(TARGETS))
    parser.add_argument("--seeds", nargs="*", type=int, default=[0, 1])
    parser.add_argument("--surveillance", nargs="*", choices=ARMS, default=list(ARMS))
    parser.add_argument("--perception", default="onnx-coco")
    parser.add_argument("--cameras", type=int, default=None, help="so many a building, instead of by area")
    parser.add_argument("--area-per-camera", type=float, default=100.0)
    parser.add_argument("--max-steps", type=int, default=500)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--table", action="store_true", help="only write the table of what there is")
    return parser


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
