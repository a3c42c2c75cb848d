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
from surveilnav.cli.removing import FromMaps, Since, Until, check_span, known_or_as_typed, remove_from_maps
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
    id = known_or_as_typed(asked, "camera", id, cameras)
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
    plan: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The floor plan (map.yaml): opens the page, where points are clicked."),
    ] = None,
    clicks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Points whose places are known. With --plan: the page reads and saves them there; default: "
            "CAMERA.clicks.yaml beside the file of cameras.",
        ),
    ] = None,
    file: Annotated[Path, typer.Option(metavar="FILE", help="The file of cameras.")] = Path("cameras.yaml"),
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The camera's picture; default: one from its stream."),
    ] = None,
    fit_hfov: Annotated[
        bool, typer.Option("--fit-hfov", help="Fit the horizontal field of view, too: six points, some off the floor.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, metavar="N", help="The page's port; default: any that is free.")
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Whether the page is opened.")] = True,
    overlay: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Without the page: draw plan and points into a picture, .jpg or .png."),
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Without the page: write the pose into the file of cameras; comments stay.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Find a camera's position and direction from points clicked in its picture and on a floor plan, on a page or from a file."""
    if plan is not None:
        if overlay is not None or write or as_json:
            raise typer.BadParameter("--overlay, --write and --json are for clicks from a file: leave out --plan")
        _calibrate_on_page(camera, plan, clicks, file, picture, fit_hfov, port, browser)
    elif clicks is None:
        raise typer.BadParameter(
            "add --plan map.yaml to click points on a page, or --clicks FILE with points from a file"
        )
    elif port is not None or not browser:
        raise typer.BadParameter("--port and --no-browser are the page's: add --plan map.yaml")
    elif picture is not None and overlay is None:
        raise typer.BadParameter("--picture is what --overlay draws into: add --overlay out.jpg")
    else:
        _calibrate_from_file(camera, clicks, file, picture, fit_hfov, overlay, write, as_json)


def _calibrate_on_page(
    camera: str,
    plan: Path,
    clicks: Path | None,
    file: Path,
    picture: Path | None,
    fit_hfov: bool,
    port: int | None,
    browser: bool,
) -> None:
    from surveilnav.cli.calibration_page.serve import serve  # loads NumPy, OpenCV and a web server
    from surveilnav.cli.calibration_page.session import Session

    session = Session(camera, file, plan, clicks or file.parent / f"{camera}.clicks.yaml", picture, fit_hfov)

    def announce(url: str) -> None:
        results.print(url, markup=False, soft_wrap=True)
        console.print("The page is there until Ctrl-C.", markup=False)

    serve(session, port or 0, browser, announce)


def _calibrate_from_file(
    camera: str,
    clicks: Path,
    file: Path,
    picture: Path | None,
    fit_hfov: bool,
    overlay: Path | None,
    write: bool,
    as_json: bool,
) -> None:
    from surveilnav.camera_pose import load_clicks  # loads NumPy and OpenCV
    from surveilnav.cameras_file.edit import write_camera
    from surveilnav.cli import calibrating

    made = calibrating.calibrate(camera, load_clicks(clicks), clicks, file, fit_hfov)
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


@app.command("calibrate-tag")
@needs("services")
def calibrate_tag(
    tag_size: Annotated[
        float | None, typer.Option(min=0.02, max=2, metavar="M", help="Side of the tag's black square, measured.")
    ] = None,
    tag_height: Annotated[
        float | None,
        typer.Option(min=0, max=5, metavar="M", help="Height of the tag's centre above the floor, measured."),
    ] = None,
    tag_id: Annotated[int, typer.Option(min=0, max=586, metavar="N", help="Number of the tag (family 36h11).")] = 0,
    file: Annotated[Path, typer.Option(metavar="FILE", help="The file of cameras.")] = Path("cameras.yaml"),
    sightings: Annotated[
        Path, typer.Option(metavar="FILE", help="Where sightings are kept. If the file is there, they are added to it.")
    ] = Path("tag_sightings.yaml"),
    robot: Annotated[str, typer.Option(metavar="ID", help="The robot with the tag, if there are several.")] = "",
    offline: Annotated[
        bool, typer.Option("--offline", help="Only solve what the file of sightings holds: no robot, no stream.")
    ] = False,
    write: Annotated[
        bool, typer.Option("--write", help="Write the poses into the file of cameras; comments stay.")
    ] = False,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Find where all cameras hang and look while a robot drives an AprilTag past them; Ctrl-C ends it and shows the result."""
    from surveilnav.cli import calibrating_tag  # loads NumPy and OpenCV

    made = calibrating_tag.TagCalibration.from_files(file, sightings, tag_id, tag_size, tag_height)
    if not offline:
        with gateway(url) as asked:
            calibrating_tag.follow(made, asked, robot, console)
    fit = made.solve()
    if not as_json:
        calibrating_tag.show(made, fit, results)
    if write:
        calibrating_tag.write(made, fit)
        console.print(f"{file}: {', '.join(fit.cameras)} have their new places", markup=False, soft_wrap=True)
    if as_json:
        print_json(calibrating_tag.as_json(made, fit, write))


@app.command("draw-tag")
@needs("services")
def draw_tag(
    out: Annotated[Path, typer.Argument(metavar="FILE", help="The picture to write: .png.")],
    tag_id: Annotated[int, typer.Option(min=0, max=586, metavar="N", help="Number of the tag (family 36h11).")] = 0,
    as_json: AsJson = False,
) -> None:
    """Draw the AprilTag for `calibrate-tag`, to be printed with its white margin."""
    from surveilnav.cli.calibrating_tag import write_tag  # loads NumPy and OpenCV

    write_tag(out, tag_id)
    told = f"{out}: written; measure the black square once it is printed"
    print_result({"file": str(out)}, as_json, lambda: results.print(told, markup=False, soft_wrap=True))


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
    if camera.quarantine:
        return "quarantined", "red"
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
    for camera in found:
        if camera.quarantine:
            told = f"camera {camera.id} isn't believed until it is calibrated anew: {camera.quarantine}"
            console.print(told, markup=False, style="red", soft_wrap=True)
