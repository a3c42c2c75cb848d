"""``surveilnav where``: where the cameras of a running system see something, without a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.exits import Exit
from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, print_result, results
from surveilnav.cli.words import clock

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.rest import Sightings

#: Of rooms of which less is in view, people are told.
_MOSTLY = 0.5


def where(
    target: Annotated[str, typer.Argument(help="What to look for, in words that the perception backend understands.")],
    floor: Annotated[str, typer.Option(metavar="ID", help="Only with the cameras of this floor.")] = "",
    max_s: Annotated[float, typer.Option(metavar="SECONDS", min=1.0, max=50.0, help="Answer after this time.")] = 10.0,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Have all cameras looked at for TARGET, without a robot, and list where it was seen. Exit 0 only if it was."""
    with gateway(url) as asked:
        found = asked.where(target, floor=floor, max_s=max_s)
    print_result(found, as_json, lambda: show_sightings(found, results))
    if not found.sightings:
        raise typer.Exit(Exit.FAILED)


def show_sightings(found: Sightings, console: Console) -> None:
    """A line a sighting, which cameras gave no picture, and which rooms no camera sees."""
    if found.sightings:
        columns = (
            Column("what", lambda s: f"{s.label} {s.object}", "text"),
            Column("floor", lambda s: s.floor, "id"),
            Column(
                "at x, y [m]", lambda s: ", ".join("?" if v is None else f"{v:.1f}" for v in s.position_m[:2]), "number"
            ),
            Column("room", lambda s: s.room),
            Column("± [m]", lambda s: f"{s.position_sigma_m:.2f}" if s.position_sigma_m else "", "number"),
            Column("status", lambda s: s.status),
            Column("chance", lambda s: "" if s.confidence is None else f"{s.confidence:.2f}", "number"),
            Column("last seen", lambda s: clock(s.last_seen) if s.last_seen else "", "number"),
            Column("by", lambda s: ", ".join(s.sources), "note"),
        )
        listing(console, columns, found.sightings)
    else:
        console.print(f"no camera sees a {found.target}", markup=False)
    for camera in found.cameras:
        if camera.lacking:
            console.print(f"camera {camera.id} wasn't looked at: {camera.lacking}", markup=False, style="yellow")
    for rooms, told in (
        ([r for r in found.rooms if not r.in_view], "no camera sees"),
        ([r for r in found.rooms if r.in_view and r.in_view < _MOSTLY], "cameras see less than half of"),
    ):
        if rooms:
            names = ", ".join(f"{r.name} (floor {r.floor})" for r in rooms)
            console.print(f"{told} {names}", markup=False, style="yellow", soft_wrap=True)
