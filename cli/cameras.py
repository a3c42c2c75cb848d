"""``surveilnav cameras``: which there are, pausing or removing one, deleting past pictures, and the file of real cameras."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.completing import camera_ids, known
from surveilnav.cli.extras import needs
from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import (
    DEFAULT_URL,
    AsJson,
    Url,
    console,
    gateway,
    items,
    only_before_nothing,
    print_json,
    print_result,
    results,
)
from surveilnav.cli.removing import FromMaps, Since, Until, check_span, remove_from_maps
from surveilnav.cli.words import clock

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.client import Client
    from surveilnav.rest import Camera

app = typer.Typer(
    invoke_without_command=True,
    help="List cameras; pause, resume or remove one; delete past pictures; check and calibrate real cameras.",
)


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
    print_result(items(found), as_json, lambda: show_cameras(found, results))


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
def remove(
    id: Id,
    from_maps: FromMaps = False,
    since: Since = None,
    until: Until = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Remove a camera whose process has ended from the list; or, --from-maps, what any camera has contributed to the maps."""
    check_span(from_maps, since, until)
    with gateway(url) as asked:
        if from_maps:
            _remove_from_maps(asked, id, since, until, as_json)
            return
        id = known(asked, "camera", id)
        asked.remove_camera(id)
    told = f"{id}: removed from the list, until it announces itself again; the maps keep what it saw (--from-maps)"
    print_result({"id": id, "removed": True}, as_json, lambda: results.print(told, markup=False, soft_wrap=True))


def _remove_from_maps(asked: Client, id: str, since: datetime | None, until: datetime | None, as_json: bool) -> None:
    cameras = {camera.id: camera for camera in asked.cameras()}
    if any(there.startswith(id) for there in cameras):  # a camera that isn't listed any more may still be in the maps
        id = known(asked, "camera", id)
    if id in cameras and not cameras[id].stale and not cameras[id].paused:
        told = f"{id} goes on looking, and what it sees from now on enters the maps: if it is wrong, `cameras pause {id}` first"
        console.print(told, markup=False, soft_wrap=True)
    remove_from_maps(asked, f"camera/{id}", since, until, as_json)


@app.command()
@needs("services")
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The file of cameras (cameras.yaml).")],
    as_json: AsJson = False,
) -> None:
    """Check a file of real cameras, without connecting to any. Exit 0 only if every camera in it can be used."""
    from surveilnav.cameras_file import load_cameras  # loads NumPy and OpenCV
    from surveilnav.cameras_file.views import views_of

    found = load_cameras(file)
    problems = [str(p) for p in found.problems]
    n_views: dict[str, int] = {}
    for name, entry in found.cameras.items():
        try:
            n_views[name] = len(views_of(entry).poses)
        except ValueError as error:
            problems.append(f"camera {name}: {error}")

    def show() -> None:
        for problem in problems:
            results.print(f"{file}, {problem}", markup=False, style="red", soft_wrap=True)
        told = f"{len(n_views)} cameras can be used, with {sum(n_views.values())} views: {', '.join(n_views) or 'none'}"
        results.print(told, markup=False, soft_wrap=True)

    print_result({"cameras": n_views, "problems": problems}, as_json, show)
    if problems:
        raise typer.Exit(1)


@app.command()
@needs("services")
def schema() -> None:
    """Print the JSON schema of the file of real cameras, for editors."""
    import json

    from surveilnav.cameras_file.model import FileModel

    print(json.dumps(FileModel.model_json_schema(), indent=2))


@app.command()
@needs("services")
def calibrate(
    camera: Annotated[str, typer.Argument(metavar="CAMERA", help="The camera's name in the file of cameras.")],
    clicks: Annotated[
        Path,
        typer.Option(metavar="FILE", help="Points in its picture whose places are known (docs/use/calibration.md)."),
    ],
    file: Annotated[Path, typer.Option(metavar="FILE", help="The file of cameras.")] = Path("cameras.yaml"),
    overlay: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw plan and points into a picture of the camera: .jpg or .png."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The picture for --overlay; default: one from the camera's stream."),
    ] = None,
    fit_hfov: Annotated[
        bool, typer.Option("--fit-hfov", help="Fit the horizontal field of view, too: six points, some off the floor.")
    ] = False,
    write: Annotated[
        bool, typer.Option("--write", help="Write the pose into the file of cameras; comments stay.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Find a camera's position and direction from points that were clicked in its picture, and say how certain they are."""
    from surveilnav.cameras_file.edit import write_camera  # loads NumPy and OpenCV
    from surveilnav.cli import calibrating

    if picture is not None and overlay is None:
        raise typer.BadParameter("--picture is what --overlay draws into: add --overlay out.jpg")
    made = calibrating.calibrate_camera(camera, clicks, file, fit_hfov)
    if not as_json:
        calibrating.show(made, results)
    if overlay is not None:
        calibrating.write_overlay(made, overlay, picture, file)
        console.print(f"{overlay}: written", markup=False, soft_wrap=True)
    if write:
        write_camera(file, camera, made.yaml_values())
        console.print(f"{file}: {camera} has its new place", markup=False, soft_wrap=True)
    if as_json:
        print_json(calibrating.as_json(made, write))


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
    print_result(camera, as_json, lambda: results.print(told, markup=False))


def state_of(camera: Camera) -> tuple[str, str]:
    """What a camera is doing, and its colour."""
    if camera.stale:
        return "offline", "red"
    if camera.paused:
        return "paused", "yellow"
    if camera.stream.state != "live":
        return camera.stream.state, "yellow" if camera.stream.state == "connecting" else "red"
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
