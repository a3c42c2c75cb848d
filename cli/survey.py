"""``surveilnav buildings``, ``homes`` and ``doctor``: what there is to search, and what this machine has."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, console, items, print_result, results

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.cli.finding import Finding


@needs("simulator")
def buildings(as_json: AsJson = False) -> None:
    """List the buildings that can be simulated, with floors, rooms and area."""
    rows = _buildings()
    print_result(items(rows), as_json, lambda: show_buildings(rows, results))


def _buildings() -> list[dict[str, Any]]:
    """A row for each name: its size is null where the number in the name decides it, or the plan isn't here."""
    from surveilnav.cli.progress import counting
    from surveilnav.simulator.sizes import sizes
    from surveilnav.simulator.sources import list_buildings

    about = {building.name: building.about for building in list_buildings()}
    rows: list[dict[str, Any]] = []
    with counting(console, "buildings") as progress:
        for name, size in sizes():
            facts = {"floors": list(size.floors), "rooms": size.rooms, "area_m2": size.area_m2} if size else {}
            rows.append({"name": name, "about": about[name], "floors": None, "rooms": None, "area_m2": None, **facts})
            progress(len(rows), len(about), name)
    return rows


def show_buildings(rows: list[dict[str, Any]], out: Console) -> None:
    """A line a building."""
    columns = (
        Column("name", lambda row: row["name"], "id"),
        Column("floors", lambda row: "" if row["floors"] is None else str(len(row["floors"])), "number"),
        Column("rooms", lambda row: _number(row["rooms"]), "number"),
        Column("m²", lambda row: _number(row["area_m2"]), "number"),
        Column("what it is", lambda row: row["about"], "note"),
    )
    listing(out, columns, rows)
    if any(row["rooms"] is None and "<n>" not in row["name"] for row in rows):
        out.print("without numbers: plans that aren't here yet; `surveilnav prepare` fetches them")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}"


@needs("simulator")
def homes(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A folder, or one file.")], as_json: AsJson = False
) -> None:
    """Say for every plan and mesh in FOLDER how much of it robots can search. Exit 1 if none could be read.

    It takes .sh3d files, Home.xml, .glb, .gltf, .obj and folders of HM3D, however deep they lie.
    """
    from surveilnav.cli.homes import as_dict, show, survey_folder
    from surveilnav.cli.progress import counting

    with counting(console, "files") as progress:
        lines = survey_folder(folder, progress)
    found = {"folder": str(folder), "homes": [as_dict(line) for line in lines]}
    print_result(found, as_json, lambda: show(lines, results))
    raise typer.Exit(0 if any(line.survey for line in lines) else 1)


def doctor(
    building: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="A real building's building.yaml: check each part of it against the running hardware, and nothing else. "
            "Or a building to be simulated: say also how much of it robots can reach.",
        ),
    ] = "",
    seconds: Annotated[
        float, typer.Option(min=1, max=120, help="building.yaml: how long each robot is listened to.")
    ] = 5.0,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Say what is missing on this machine or wrong in a real building, and what to do. Exit 1 if something must be mended."""
    if building.lower().endswith((".yaml", ".yml")):
        _diagnose_building(Path(building), seconds, url, as_json)
    else:
        _diagnose_machine(building, as_json)


@needs("services")
def _diagnose_building(path: Path, seconds: float, url: str, as_json: bool) -> None:
    from surveilnav.cli.building_check.check import examine_building
    from surveilnav.cli.progress import counting

    with counting(console, "checks") as progress:
        findings = examine_building(path, seconds, url, progress)
    _tell(findings, as_json)


@needs("simulator")
def _diagnose_machine(building: str, as_json: bool) -> None:
    from surveilnav.cli.doctor import examine
    from surveilnav.cli.progress import bar

    with bar(console) as progress:
        findings = examine(building, progress)
    _tell(findings, as_json)


def _tell(findings: list[Finding], as_json: bool) -> None:
    from surveilnav.cli.finding import show

    print_result({"findings": [f.as_dict() for f in findings]}, as_json, lambda: show(findings, results))
    raise typer.Exit(1 if any(f.level == "problem" for f in findings) else 0)
