"""``surveilnav bench``: play a split of the dataset, and make tables of what came out."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surveilnav.cli.dataset import DEFAULT_ROOT, Root
from surveilnav.cli.extras import needs
from surveilnav.cli.options import AsJson, console, results

if TYPE_CHECKING:
    from surveilnav.benchmark.runner.run import Finished
    from surveilnav.benchmark.tables.arms import Table
    from surveilnav.benchmark.tables.make import Made

CameraDepth = Annotated[
    str, typer.Option(help="sensor or none: whether cameras measure depth. Without it, things are put on the floor.")
]
PerScene = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Play only this many episodes of each scene, spread over its categories; a start without it plays the rest.",
    ),
]

app = typer.Typer(no_args_is_help=True, help="The benchmark: policies on the dataset.")


@app.command()
@needs("bench")
def run(
    split: Annotated[str, typer.Option(help="val, val_mini, train, or one of your own.")] = "val_mini",
    policy: Annotated[str, typer.Option(help="One of `surveilnav bench policies`.")] = "surveilnav",
    planner: Annotated[
        str,
        typer.Option(
            help="How the robot drives: fmm by the map known so far, sp by the simulator's true navigation mesh."
        ),
    ] = "fmm",
    drive: Annotated[
        str,
        typer.Option(
            help="How the robot moves: actions, one discrete action at a time, or waypoints, driving to poses by itself."
        ),
    ] = "actions",
    localisation: Annotated[
        str,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="How wrong a robot that drives to waypoints is about where it is: sigma_m, sigma_deg, drift, frame_m, "
            "frame_deg, jump_m, jump_after_m.",
        ),
    ] = "",
    surveillance: Annotated[str, typer.Option(help="on or off: whether cameras take part.")] = "on",
    perception: Annotated[
        str, typer.Option(help="Perception backend: simulated, oracle, compact or onnx-coco.")
    ] = "simulated",
    camera_perception: Annotated[
        str,
        typer.Option(help="oracle: the cameras have a perfect detector, a bound; by default they have --perception."),
    ] = "",
    density: Annotated[int, typer.Option(help="One camera for this many square metres of floor: 100 or 200.")] = 100,
    views: Annotated[str, typer.Option(help="Views of a camera: panoramic (360 degrees) or half (180).")] = "panoramic",
    camera_depth: CameraDepth = "sensor",
    camera_tier: Annotated[
        str,
        typer.Option(
            help="What cameras send: raw, jpeg+depth, jpeg, features or objects; needs --perception compact or onnx-coco."
        ),
    ] = "jpeg+depth",
    language_model: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="The model that the policy llm asks, as the server at SURVEILNAV_LLM__URL knows it.",
        ),
    ] = "",
    max_steps: Annotated[int, typer.Option(min=1, max=5000)] = 500,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    per_scene: PerScene = None,
    workers: Annotated[int, typer.Option(min=1, max=64)] = os.cpu_count() or 1,
    root: Root = DEFAULT_ROOT,
    out: Annotated[
        Path | None, typer.Option(help="The run's folder; started again, it plays only what is missing there.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Play episodes. You may kill it at any time and start it again. Exit 0 only if all episodes were played."""
    from surveilnav.benchmark.runner.run import run as play
    from surveilnav.benchmark.runner.settings import RunSettings, run_id
    from surveilnav.cli.progress import counting
    from surveilnav.errors import ConfigError

    settings = RunSettings(
        split=split,
        policy=policy,
        planner=planner,  # type: ignore[arg-type]
        drive=drive,  # type: ignore[arg-type]
        localisation=_parse_localisation_errors(localisation),
        surveillance=_on(surveillance),
        perception=perception,  # type: ignore[arg-type]
        camera_perception=camera_perception,  # type: ignore[arg-type]
        density_m2=density,
        views=views,  # type: ignore[arg-type]
        camera_depth=camera_depth,  # type: ignore[arg-type]
        camera_tier=camera_tier,  # type: ignore[arg-type]
        language_model=language_model,
        max_steps=max_steps,
        seed=seed,
    )
    folder = out or Path("runs/bench") / run_id(settings)
    began_s = time.monotonic()
    with counting(console, "episodes") as progress:
        finished = play(
            root,
            folder,
            settings,
            workers=workers,
            per_scene=per_scene,
            on_progress=lambda p: progress(p.done, p.total, ""),
        )
    _say_faults(finished)
    if not finished.records:
        raise ConfigError(f"no episode could be played; see above, or {folder}")
    _print_outcome(finished, folder, time.monotonic() - began_s, as_json)
    sys.exit(0 if finished.complete else 1)


def _parse_localisation_errors(text: str) -> dict[str, float]:
    """The errors of a robot's localisation by name, of a text such as ``drift=0.01,sigma_m=0.02``."""
    pairs = [part.partition("=") for part in text.split(",") if part]
    try:
        return {name.strip(): float(value) for name, _, value in pairs}
    except ValueError:
        raise typer.BadParameter(f"expected numbers, such as drift=0.01,sigma_m=0.02, got {text!r}") from None


def _print_outcome(finished: Finished, folder: Path, seconds: float, as_json: bool) -> None:
    """Prints what came out of a run."""
    from surveilnav.benchmark.runner.summary import SUCCESS_RULE, summarise

    if as_json:
        print(json.dumps(_numbers(finished, folder, seconds)))
        return
    s = summarise(finished.records)
    console.print(
        f"{s.episodes} of {s.episodes + finished.missing} episodes: SR {s.sr}, SPL {s.spl}, SoftSPL {s.soft_spl}"
    )
    console.print("  " + ", ".join(f"{k} {v}" for k, v in s.reasons.items()))
    if finished.cost:
        console.print(f"  language model: {finished.cost}")
    console.print(f"  success: {SUCCESS_RULE}; records in {folder}")


def _say_faults(finished: Finished) -> None:
    """What of a run isn't counted, and what was played again."""
    for scene, number in finished.mended:
        console.print(
            f"[yellow]the record of {scene} episode {number} could not be read, so it was forgotten and played again[/]"
        )
    for scene, why in finished.unopened.items():
        console.print(f"[red]{scene} could not be played:[/] {why}")
    for broken in finished.broken:
        last = broken.error.strip().splitlines()[-1]
        console.print(f"[red]{broken.scene} episode {broken.episode_id} broke (not counted):[/] {last}")


def _numbers(finished: Finished, folder: Path, seconds: float) -> dict[str, Any]:
    """A run as one object."""
    import msgspec

    from surveilnav.benchmark.runner.summary import SUCCESS_RULE, summarise

    s = summarise(finished.records)
    return {
        "sr": round(s.sr.mean, 2),
        "spl": round(s.spl.mean, 2),
        "soft_spl": round(s.soft_spl.mean, 2),
        "episodes": s.episodes,
        "seconds": round(seconds, 1),
        "traffic": s.bytes,
        "success": SUCCESS_RULE,
        "missing": finished.missing,
        "broken": len(finished.broken),
        "unopened": finished.unopened,
        "episode_seconds": round(sum(r.seconds for r in finished.records), 1),
        "reasons": s.reasons,
        "out": str(folder),
        **({"language_model": msgspec.to_builtins(finished.cost)} if finished.cost else {}),
    }


@app.command()
@needs("bench")
def table(
    name: Annotated[list[str] | None, typer.Argument(help="main, range, density, ...; by default all.")] = None,
    workers: Annotated[int, typer.Option(min=1, max=64)] = os.cpu_count() or 1,
    root: Root = DEFAULT_ROOT,
    out: Annotated[Path, typer.Option(help="Folder for pages, plots and runs.")] = Path("docs/results/bench"),
    arm: Annotated[
        list[str] | None,
        typer.Option(
            help="Play only arms with this label, or with this in their label; pages show what was played of the others."
        ),
    ] = None,
    per_scene: PerScene = None,
    play: Annotated[bool, typer.Option(help="--no-play: play nothing, only write pages of what was played.")] = True,
    as_json: AsJson = False,
) -> None:
    """Make tables: play what is missing of their runs, write pages and plots. Exit 0 only if every episode that was asked
    for was played."""
    from surveilnav.benchmark.tables.arms import TABLES, Arm
    from surveilnav.benchmark.tables.make import expect_own_runs, make
    from surveilnav.cli.progress import counting
    from surveilnav.errors import ConfigError

    if unknown := [n for n in name or () if n not in TABLES]:
        raise ConfigError(f"there is no table {unknown[0]!r}; there are {', '.join(TABLES)}")
    if arm and not play:
        raise ConfigError("--no-play plays nothing, so --arm says nothing: leave one of them out")
    chosen = _labels_with(arm or (), name)

    def wanted(a: Arm) -> bool:
        return play and (not arm or a.label in chosen)

    tables = [TABLES[one] for one in name or TABLES]
    tables = [t for t in tables if not arm or any(map(wanted, t.arms))]
    expect_own_runs(tables, root, out, wanted)
    said = []
    for one in tables:
        with counting(console, "episodes") as progress:
            made = make(one, root, out, workers=workers, per_scene=per_scene, on_progress=progress, wanted=wanted)
        said.append(_said(one, made))
    if as_json:
        print(json.dumps({"tables": said}))
    sys.exit(0 if all(table["complete"] for table in said) else 1)


def _labels_with(texts: Sequence[str], names: Sequence[str] | None) -> list[str]:
    """The labels of tables' arms that are one of ``texts``, or have one in it that is no arm's. ConfigError: none has."""
    from surveilnav.benchmark.tables.arms import TABLES
    from surveilnav.errors import ConfigError

    labels = [a.label for one in names or TABLES for a in TABLES[one].arms]
    chosen = [label for text in texts for label in labels if text == label or (text in label and text not in labels)]
    for text in texts:
        if not any(text in label for label in chosen):
            where = (
                f"there are: {'; '.join(labels)}" if names else "name the table, and the arms that it has are listed"
            )
            raise ConfigError(f"no arm has {text!r} in its label; {where}")
    return chosen


def _said(table: Table, made: Made) -> dict[str, Any]:
    """What came of a table, as one object; people are told, too."""
    for episode in made.mended:
        console.print(f"[yellow]could not be read, so it was forgotten and played again:[/] {episode}")
    for fault in made.faults:
        console.print(f"[red]not counted:[/] {fault}")
    page = str(made.page) if made.page.exists() else None
    there = page or f"{table.name}: no page, nothing was played with this program"
    console.print(f"{there} ({made.played} of {len(table.arms)} arms are played)")
    return {
        "table": table.name,
        "page": page,
        "arms": len(table.arms),
        "played": made.played,
        "complete": made.complete,
        "not_counted": made.faults,
        "mended": made.mended,
    }


@app.command()
@needs("bench")
def explain(
    run: Annotated[Path, typer.Argument(help="The folder of a run of `bench run`.", show_default=False)],
    bound: Annotated[
        list[Path] | None,
        typer.Option(
            help="The folder of a run to compare with it, such as one of a bound; may be given several times."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The page (.md), with its picture beside it; by default beside the run's folder."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say where the SPL of a run is lost: on the way to a goal, near it, or by failing; by what cameras see, class and building;
    and what bounds would gain."""
    from surveilnav.benchmark.explain.make import explain as write
    from surveilnav.cli.bench_words import explained_in_words, explained_numbers

    explained = write(run, bound or (), out)
    if as_json:
        print(json.dumps(explained_numbers(explained)))
        return
    for line in explained_in_words(explained):
        results.print(line, soft_wrap=True)
    console.print(f"{explained.page} has the tables and a picture")


@app.command()
@needs("bench")
def policies(as_json: AsJson = False) -> None:
    """List the policies, and what each does."""
    from surveilnav.benchmark.policies import POLICIES

    if as_json:
        print(json.dumps({p.name: p.about for p in POLICIES.values()}))
        return
    for p in POLICIES.values():
        results.print(f"[bold]{p.name}[/]  {p.about}")


def _on(value: str) -> bool:
    if value not in ("on", "off"):
        raise typer.BadParameter(f"surveillance is on or off, got {value!r}")
    return value == "on"
