"""``surveilnav models``: list, pull and check what looks at pixels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from surveilnav.cli.extras import needs
from surveilnav.cli.options import AsJson, console, items, print_json, results

if TYPE_CHECKING:
    from surveilnav.perception import models

app = typer.Typer(no_args_is_help=True, help="Detectors, segmenters, embedders, depth: list, pull, check.")

Names = Annotated[list[str], typer.Argument(help="Names of models, from `surveilnav models list`.")]


@app.command("list")
@needs("services")
def list_models(as_json: AsJson = False) -> None:
    """List the models with size and licence, and where they are on this machine."""
    from surveilnav.cli.listing import Column, listing
    from surveilnav.perception import models

    rows = [_row(model) for model in models.CATALOGUE.values()]
    if as_json:
        print_json(items(rows))
        return
    columns = (
        Column("model", lambda row: row["name"], "id"),
        Column("kind", lambda row: row["kind"]),
        Column("MB", lambda row: f"{row['bytes'] / 1e6:,.0f}" if row["bytes"] else "?", "number"),
        Column("licence", lambda row: row["licence"], "text"),
        Column("hash", lambda row: row["hash"]),
        Column("here", lambda row: (row["fault"], "red") if row["fault"] else row["path"] or "-", "note"),
    )
    listing(results, columns, rows)
    results.print(
        "\nhash: `known` stands in the catalogue, `card` beside the weights. `first pull` is trusted when it "
        "first comes, and written into models.lock.json; later content is held to it.\n"
        "MB counts the weights. `--json` has notes and sources."
    )


def _row(model: models.Model) -> dict[str, Any]:
    from surveilnav.perception import models

    seen = models.survey(model.name)
    return {
        "name": model.name,
        "kind": model.kind,
        "family": model.family,
        "vocabulary": model.vocabulary,
        "bytes": _size_bytes(model, seen),
        "licence": model.licence,
        "hash": _hash_known(model),
        "source": model.source or model.setting,
        "confirmed": model.confirmed,
        "note": model.note,
        "path": str(seen.path) if seen.path else "",
        "fault": seen.fault,
    }


def _size_bytes(model: models.Model, seen: models.LocalModel) -> int:
    """What the catalogue says; of what is built in, what lies there."""
    return seen.path.stat().st_size if model.built_in and seen.path and seen.path.is_file() else model.size_bytes


def _hash_known(model: models.Model) -> str:
    """Whether the weights' hash stands in the catalogue, or in the card of what is built in."""
    if model.built_in:
        return "card"
    if not model.source:
        return "none"
    return "known" if any(file.sha256 for file in model.files) else "first pull"


@app.command()
@needs("services")
def pull(
    names: Names,
    to: Annotated[Path | None, typer.Option(help="The folder to download into; by default the cache.")] = None,
    as_json: AsJson = False,
) -> None:
    """Download models. A broken-off download continues; a model that is here already is checked and kept."""
    from surveilnav.cli.progress import downloading
    from surveilnav.perception import models

    found: dict[str, str] = {}
    for model in [models.model_called(name) for name in names]:  # a wrong name ends it before the first byte
        console.print(f"{model.name}: {model.licence}, from {model.source or model.setting}", soft_wrap=True)
        with downloading(console) as on_progress:
            found[model.name] = str(models.pull(model.name, to=to, on_progress=on_progress))
        console.print(f"[green]ok[/] {escape(found[model.name])}", soft_wrap=True)
    if as_json:
        print_json(found)


@app.command()
@needs("services")
def check(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Names, or paths of folders; by default all models of the catalogue that are here."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the hashes of models, and compare. Exit 1 if one is damaged, or was named and isn't here."""
    from surveilnav.cli.progress import counting
    from surveilnav.perception import models

    asked, seen = list(names or models.CATALOGUE), dict[str, models.LocalModel]()
    with counting(console, "models") as progress:  # gigabytes are hashed
        for name in asked:
            progress(len(seen), len(asked), name)
            seen[name] = models.survey(name, anew=True)
    if not names:
        seen = {name: found for name, found in seen.items() if found.path}
    faults = {name: found.fault or ("" if found.path else _not_here(name)) for name, found in seen.items()}
    ids = {name: models.model_id(name, found.path) for name, found in seen.items() if found.path and not faults[name]}
    if as_json:
        said = {name: {"ok": not fault, "fault": fault, "id": ids.get(name, "")} for name, fault in faults.items()}
        print_json(said)
    else:
        for name, fault in faults.items():
            line = (
                f"[red]wrong[/] {name}: {escape(fault)}" if fault else f"[green]ok[/]    {ids[name]}: {seen[name].path}"
            )
            console.print(line, soft_wrap=True)
        if not faults:
            console.print("no model is on this machine; `surveilnav models list` says which there are")
    raise typer.Exit(1 if any(faults.values()) else 0)


def _not_here(name: str) -> str:
    from surveilnav.perception.models import model_called

    model = model_called(name)
    return f"not on this machine. {f'`surveilnav models pull {name}` fetches it.' if model.source else model.note}"
