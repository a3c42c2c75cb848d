"""``surveilnav dataset``: build, check and show the collaborative dataset."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.options import BUILDING_KINDS, AsJson, console

if TYPE_CHECKING:
    from surveilnav.benchmark.dataset.splits import SplitSpec

app = typer.Typer(no_args_is_help=True, help="The collaborative dataset: buildings, cameras, episodes.")

DEFAULT_ROOT = Path("data/surveilnav-v2")
Root = Annotated[Path, typer.Option(help="The dataset's folder.")]


@app.command()
@needs("bench")
def build(
    split: Annotated[
        list[str] | None,
        typer.Option(help="val, val_mini or train (by default all); or the name of your own split, with --building."),
    ] = None,
    building: Annotated[
        list[str] | None,
        typer.Option(help=f"A building of your own split: {BUILDING_KINDS}."),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="Episodes in each building of your own split; by default 10.")
    ] = None,
    root: Root = DEFAULT_ROOT,
    workers: Annotated[int, typer.Option(min=1, max=64)] = os.cpu_count() or 1,
    anew: Annotated[
        bool, typer.Option("--anew", help="Build also what is there already, after an update of program or furniture.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Build the dataset, or whatever is missing or damaged of it. You may stop it at any time and start it again.

    With --building it makes a split of your own buildings, with the name from --split (by default "own").
    """
    import msgspec

    from surveilnav.benchmark.dataset.make import make
    from surveilnav.benchmark.dataset.splits import own_split, splits_of
    from surveilnav.cli.progress import counting
    from surveilnav.errors import ConfigError

    if building and len(split or ()) > 1:
        raise ConfigError("buildings of your own make one split: name one")
    if episodes and not building:
        raise ConfigError("--episodes is for a split of your own: name its buildings with --building")
    splits = [own_split(split[0] if split else "own", building, episodes or 10)] if building else splits_of(split)
    with counting(console, "scenes") as progress:
        manifest = make(root, splits, workers=workers, anew=anew, on_progress=progress)
    if as_json:
        print(msgspec.json.encode(manifest).decode())
        return
    for scene, note in _notes(root, splits):
        console.print(f"note: {scene}: {note}", markup=False)
    for name, c in manifest.splits.items():
        console.print(f"{name}: {c.scenes} scenes, {c.floors} floors, {c.cameras} cameras, {c.episodes} episodes")


def _notes(root: Path, splits: Sequence[SplitSpec]) -> Iterator[tuple[str, str]]:
    """What people should know of the splits' scenes: of each its name and a note."""
    from surveilnav.benchmark.dataset.format import SceneRecord, read

    for split in splits:
        for spec in split.scenes:
            for note in read(root / split.name / "scenes" / f"{spec.scene}.json", SceneRecord).notes:
                yield spec.scene, note


@app.command()
@needs("bench")
def check(
    root: Root = DEFAULT_ROOT,
    deep: Annotated[bool, typer.Option(help="Also open every building and compare.")] = True,
    as_json: AsJson = False,
) -> None:
    """Check a dataset and list what is wrong with it. Exit 0 only if nothing is."""
    from surveilnav.benchmark.dataset.check import check as faults_of
    from surveilnav.cli.progress import counting

    with counting(console, "scenes") as progress:
        faults = list(faults_of(root, deep=deep, on_scene=progress))
    errors = sum(f.level == "error" for f in faults)
    if as_json:
        print(json.dumps({"errors": errors, "notes": len(faults) - errors, "faults": [asdict(f) for f in faults]}))
    else:
        for f in faults:
            console.print(f"[{'red' if f.level == 'error' else 'yellow'}]{f.level}[/] {f.where}: {f.what}")
    console.print(f"{errors} errors, {len(faults) - errors} notes")
    sys.exit(1 if errors else 0)


@app.command()
@needs("bench")
def show(
    root: Root = DEFAULT_ROOT,
    split: Annotated[str, typer.Option()] = "val",
    scene: Annotated[list[str] | None, typer.Option(help="Scenes; by default all.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the pictures.")] = Path("runs/dataset"),
    as_json: AsJson = False,
) -> None:
    """Draw floors, cameras with what they see, goals and starts."""
    from surveilnav.benchmark.dataset.integrity import read_manifest
    from surveilnav.benchmark.dataset.load import scenes_of
    from surveilnav.benchmark.dataset.show import draw
    from surveilnav.cli.progress import counting

    read_manifest(root)
    scenes = scene or scenes_of(root, split)
    area_m2 = seen_m2 = 0.0
    said = []
    with counting(console, "scenes") as progress:
        for done, name in enumerate(scenes, start=1):
            drawn = draw(root, split, name, out)
            progress(done, len(scenes), name)
            console.print(
                f"{drawn.path}: cameras see {100 * drawn.seen_m2 / drawn.area_m2:.0f} % of {drawn.area_m2:.0f} m2"
            )
            area_m2, seen_m2 = area_m2 + drawn.area_m2, seen_m2 + drawn.seen_m2
            said.append({"scene": name, "picture": str(drawn.path), "area_m2": drawn.area_m2, "seen_m2": drawn.seen_m2})
    if as_json:
        print(json.dumps({"scenes": said}))
    if len(scenes) > 1:
        console.print(f"{len(scenes)} scenes: cameras see {100 * seen_m2 / area_m2:.0f} % of {area_m2:.0f} m2 indoors")
