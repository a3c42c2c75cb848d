"""``surveilnav cameras``: which there are, pausing or forgetting one, and deleting past pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.completing import camera_ids, known
from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import (
    DEFAULT_URL,
    AsJson,
    Url,
    gateway,
    items,
    only_before_nothing,
    print_json,
    put,
    results,
)
from surveilnav.cli.words import clock

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.rest import Camera

app = typer.Typer(invoke_without_command=True, help="List cameras; pause, resume or remove one; delete past pictures.")


Id = Annotated[
    str,
    typer.Argument(metavar="ID", autocompletion=camera_ids, help="A camera's id, or its beginning if that is unique."),
]


@app.callback()
def list_all(ctx: typer.Context, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """List cameras: where they are, whether they are invoked, what they saw; or pause, resume or remove one."""
    only_before_nothing(ctx)
    if ctx.invoked_subcommand:
        return
    with gateway(url) as asked:
        found = asked.cameras()
    put(items(found), as_json, lambda: show_cameras(found, results))


@app.command()
def pause(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Pause a camera: it sends no pictures, whoever asks, and detects nothing."""
    with gateway(url) as asked:
        _changed(asked.pause_camera(known(asked, "camera", id)), as_json)


@app.command()
def resume(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Resume a paused camera."""
    with gateway(url) as asked:
        _changed(asked.resume_camera(known(asked, "camera", id)), as_json)


@app.command()
def forget(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Remove a camera whose process has ended from the list."""
    with gateway(url) as asked:
        id = known(asked, "camera", id)
        asked.remove_camera(id)
    told = f"{id}: forgotten, until it announces itself again"
    put({"id": id, "forgotten": True}, as_json, lambda: results.print(told, markup=False))


@app.command("delete-pictures")
def delete_pictures(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Delete all past pictures now, but no maps, objects or recordings."""
    with gateway(url) as asked:
        keepers = asked.forget_pictures()
    if as_json:
        print_json(items(keepers))
        return
    for keeper in keepers:
        results.print(f"{keeper.keeper}: {keeper.message}", markup=False)


def _changed(camera: Camera, as_json: bool) -> None:
    told = f"{camera.id}: {'paused' if camera.paused else 'looks again'}"
    put(camera, as_json, lambda: results.print(told, markup=False))


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
        Column("id", lambda c: c.id, "id"),
        Column("floor", lambda c: c.floor, "id"),
        Column("at x, y [m]", lambda c: f"{c.position_m[0]:.1f}, {c.position_m[1]:.1f}", "number"),
        Column("state", state_of),
        Column("views", lambda c: f"{c.views_processed}/{len(c.views)}", "number"),
        Column("last heard of", lambda c: clock(c.last_seen), "number"),
        Column("saw", lambda c: ", ".join(f"{k} {v:.2f}" for k, v in c.labels.items() if v is not None), "note"),
    )
    listing(console, columns, found)
