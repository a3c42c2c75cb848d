"""``surveilnav cameras``: which there are, pausing or forgetting one, and deleting past pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, items, only_before_nothing, print_json, results
from surveilnav.cli.words import clock

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.client import Client
    from surveilnav.rest import Camera

app = typer.Typer(invoke_without_command=True, help="List cameras; pause, resume or remove one; delete past pictures.")


def _ids(ctx: typer.Context, incomplete: str) -> list[str]:
    """For the shell: cameras that begin so; none if no gateway answers."""
    from surveilnav.cli.completing import camera_ids

    return camera_ids(ctx, incomplete)


Id = Annotated[
    str,
    typer.Argument(metavar="ID", autocompletion=_ids, help="A camera's id, or its beginning if that is unique."),
]


@app.callback()
def list_all(ctx: typer.Context, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """List cameras: where they are, whether they are invoked, what they saw; or pause, resume or remove one."""
    only_before_nothing(ctx)
    if ctx.invoked_subcommand:
        return
    with gateway(url) as asked:
        found = asked.cameras()
    if as_json:
        print_json(items(found))
    else:
        show_cameras(found, results)


@app.command()
def pause(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Pause a camera: it sends no pictures, whoever asks, and detects nothing."""
    with gateway(url) as asked:
        _changed(asked.pause_camera(_known(asked, id)), as_json)


@app.command()
def resume(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Resume a paused camera."""
    with gateway(url) as asked:
        _changed(asked.resume_camera(_known(asked, id)), as_json)


@app.command()
def forget(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Remove a camera whose process has ended from the list."""
    with gateway(url) as asked:
        id = _known(asked, id)
        asked.remove_camera(id)
    if as_json:
        print_json({"id": id, "forgotten": True})
    else:
        results.print(f"{id}: forgotten, until it announces itself again", markup=False)


@app.command("delete-pictures")
def delete_pictures(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Delete all past pictures now, but no maps, objects or recordings."""
    with gateway(url) as asked:
        keepers = asked.forget_pictures()
    if as_json:
        print_json(items(keepers))
    else:
        for keeper in keepers:
            results.print(f"{keeper.keeper}: {keeper.message}", markup=False)


def _known(asked: Client, typed: str) -> str:
    """The id that was meant: as typed, or the only one that begins so."""
    from surveilnav.cli.completing import meant

    return meant("camera", typed, [camera.id for camera in asked.cameras()])


def _changed(camera: Camera, as_json: bool) -> None:
    if as_json:
        print_json(camera)
    else:
        results.print(f"{camera.id}: {'paused' if camera.paused else 'looks again'}", markup=False)


def state_of(camera: Camera) -> tuple[str, str]:
    """What a camera is doing, and its colour."""
    if camera.stale:
        return "offline", "red"
    if camera.paused:
        return "paused", "yellow"
    return ("invoked", "green") if camera.invoked else ("idle", "")


def show_cameras(found: list[Camera], console: Console) -> None:
    """A line a camera."""
    if not found:
        console.print("no camera has announced itself; see `surveilnav status`")
        return
    columns = (
        Column("id", "id"),
        Column("floor", "id"),
        Column("at x, y [m]", "number"),
        Column("state"),
        Column("views", "number"),
        Column("last heard of", "number"),
        Column("saw", "note"),
    )
    listing(
        console,
        columns,
        [
            [
                c.id,
                c.floor,
                f"{c.position_m[0]:.1f}, {c.position_m[1]:.1f}",
                state_of(c),
                f"{c.views_processed}/{len(c.views)}",
                clock(c.last_seen),
                ", ".join(f"{label} {chance:.2f}" for label, chance in c.labels.items() if chance is not None),
            ]
            for c in found
        ],
    )
