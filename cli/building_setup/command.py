"""``surveilnav init``: a building's files, from answers."""

from __future__ import annotations

import shutil
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.options import AsJson, console, print_result, results

if TYPE_CHECKING:
    from surveilnav.cli.building_setup.answers import Answers
    from surveilnav.cli.building_setup.plans import FloorFiles

_LISTED = 3


@needs("services")
def init(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Where the files are written; it is made if it isn't there.")
    ] = Path("building"),
    answers: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A file with the answers (YAML), instead of being asked.")
    ] = None,
    offline: Annotated[
        bool, typer.Option("--offline", help="Don't look at streams for the size of their pictures.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there already.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write the files of a real building: its floors, cameras and robots, and what Docker Compose needs. It asks for each."""
    from surveilnav.cameras_file.passwords import FILE_NAME
    from surveilnav.cli.building_setup.answers import load_answers
    from surveilnav.cli.building_setup.asking import ask_all
    from surveilnav.cli.building_setup.plans import files_of_floor
    from surveilnav.cli.building_setup.texts import BUILDING, CAMERAS, OVERRIDE, texts_of
    from surveilnav.cli.building_setup.writing import refuse_existing, write_all

    if not force:  # before anybody answers for nothing
        refuse_existing([folder / name for name in (BUILDING, CAMERAS, FILE_NAME, OVERRIDE)])
    given = load_answers(answers) if answers else ask_all(folder)
    base = answers.parent if answers else Path()
    floors = {name: files_of_floor(name, floor, base, folder) for name, floor in given.floors.items()}
    texts_of(given, floors, {}, folder)  # a mistake is told before anybody waits for streams
    files = texts_of(given, floors, {} if offline else _sizes_px(given, folder), folder)
    if not force:
        refuse_existing([folder / name for name in files])
    write_all(folder, files)
    commands = _next_commands(given, floors, folder)

    def show() -> None:
        results.print(f"{folder}: {', '.join(files)}", markup=False, soft_wrap=True)
        results.print("\nNext:", markup=False)
        for command in commands:
            results.print(f"  {command}", markup=False, soft_wrap=True)

    print_result({"folder": str(folder), "files": list(files), "next": commands}, as_json, show)


def _sizes_px(answers: Answers, folder: Path) -> dict[str, tuple[int, int]]:
    """The sizes of the pictures of cameras whose answers don't say it, as far as their streams can be reached."""
    from functools import partial

    from surveilnav.cameras_file.urls import with_secrets
    from surveilnav.cli.building_setup.texts import DEFAULT_PX, stream_of
    from surveilnav.cli.progress import counting
    from surveilnav.cli.stream_probe import ProbeResult, at_once, deadline_s, probe

    asked = {c.name: stream_of(c) for c in answers.cameras if c.picture_px is None}
    if not asked:
        return {}
    tasks = {}
    for name, (stream, secrets) in asked.items():
        tasks[name] = partial(probe, with_secrets(stream, secrets) if secrets else stream, folder, 0.0)
    with counting(console, "streams") as progress:
        done: list[str] = []

        def on_done(name: str) -> None:
            done.append(name)
            progress(len(done), len(tasks), name)

        probed = at_once(tasks, deadline_s(len(tasks)), lambda _: ProbeResult(problem="it doesn't answer"), on_done)
    for name, seen in probed.items():
        if seen.size_px == (0, 0):
            width, height = DEFAULT_PX
            told = f"camera {name}: {seen.problem}. Its pictures are taken to have {width}x{height} pixels"
            console.print(f"note: {told}", markup=False, soft_wrap=True)
    return {name: seen.size_px for name, seen in probed.items() if seen.size_px != (0, 0)}


def _next_commands(answers: Answers, floors: dict[str, FloorFiles], folder: Path) -> list[str]:
    """What to type now, in order."""
    from surveilnav.cli.building_setup.texts import BUILDING, CAMERAS, OVERRIDE
    from surveilnav.cli.calibrating import command_for

    unknown = [camera for camera in answers.cameras if camera.position_m is None]
    commands = [f"surveilnav doctor --building {quote(str(folder / BUILDING))}"]
    for camera in unknown[:_LISTED]:
        plan = floors[camera.floor].plan
        commands.append(
            command_for(camera.name, folder / plan if plan else None, folder / CAMERAS, camera.hfov_deg is None)
        )
    if len(unknown) > _LISTED:
        commands.append(f"...   # and so for {', '.join(camera.name for camera in unknown[_LISTED:])}")
    for name, robot in answers.robots.items():
        if not (robot.on_nav2_map and floors[robot.floor].T_building_map):
            commands.append(
                f"surveilnav robots frame {quote(f'{folder}/robots/{name}.yaml')} --pair X,Y=X,Y ... --write"
            )
    where = "" if shutil.which("docker") else "   # with Docker, in a clone of SurveilNav"
    commands.append(f"docker compose -f compose.building.yaml -f {quote(str(folder / OVERRIDE))} up --wait{where}")
    commands.append("surveilnav where wheelchair")
    return commands
