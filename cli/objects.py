"""``surveilnav objects``: what the maps of a running system hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, items, print_result, results

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.rest import Object


def objects(
    text: Annotated[
        str,
        typer.Argument(
            help="Objects that look most like this come first. A backend with a closed set of classes refuses other words.",
            show_default=False,
        ),
    ] = "",
    label: Annotated[str, typer.Option(metavar="WORD", help="Only objects with this label.")] = "",
    floor: Annotated[str, typer.Option(metavar="ID", help="Only objects of this floor.")] = "",
    state: Annotated[
        str,
        typer.Option(
            "--status", metavar="WORD", help="Only objects with this status: confirmed, candidate or rejected."
        ),
    ] = "",
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """List the objects that the running system has seen; with TEXT, those that look most like it first."""
    with gateway(url) as asked:
        found = asked.objects(text, label=label, floor=floor, status=state)
    print_result(items(found), as_json, lambda: show_objects(found, results))


def show_objects(found: list[Object], console: Console) -> None:
    """A line an object."""
    if not found:
        console.print("nothing is known of such objects yet")
        return
    columns = (
        Column("object", lambda o: f"{o.label} {o.id}", "text"),
        Column("floor", lambda o: o.floor, "id"),
        Column("at x, y, z [m]", lambda o: ", ".join("?" if v is None else f"{v:.1f}" for v in o.center_m), "number"),
        Column("status", lambda o: o.status),
        Column("chance", lambda o: _share(o.confidence), "number"),
        Column("fits", lambda o: _share(o.relevance), "number"),
        Column("seen by", lambda o: ", ".join(o.sources), "note"),
    )
    listing(console, columns, found)


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
