"""``surveilnav``: the command line."""

from __future__ import annotations

import json
import signal
import sys
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.rich_utils import rich_format_error

from cli import bench, dataset, models
from cli.mistakes import as_object, in_words, usage_of
from cli.options import BUILDING_KINDS, AsJson
from cli.terminal import Terminal
from surveilnav.perception.names import BackendName

if TYPE_CHECKING:
    from surveilnav.client import Client

app = typer.Typer(
    name="surveilnav", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    help="Surveillance cameras and a robot search a building together.",
)  # fmt: skip
app.add_typer(dataset.app, name="dataset")
app.add_typer(bench.app, name="bench")
app.add_typer(models.app, name="models")
console = Terminal(stderr=True, highlight=False)
results = Terminal(highlight=False)


DEFAULT_CAMERAS = 4


class OnOff(StrEnum):
    on = "on"
    off = "off"


Building = Annotated[str, typer.Option(help=f"Which building: {BUILDING_KINDS}.")]
Seed = Annotated[int, typer.Option(min=0, help="Draws furniture models, textures, start and sensor noise.")]
Cameras = Annotated[int | None, typer.Option(min=0, max=10_000, help="So many cameras in all (4 if no area is given).")]
Area = Annotated[float | None, typer.Option(min=1.0, help="One camera for so many square metres of floor.")]
Everywhere = Annotated[
    bool, typer.Option("--cameras-everywhere", help="Cameras also on floors that robots can't get to.")
]
Record = Annotated[OnOff, typer.Option(help="Whether each mission becomes a file, to be shown again by `replay`.")]
Perception = Annotated[BackendName, typer.Option(help="What looks at the pictures; auto takes the best that can run.")]
Text = Annotated[
    str, typer.Argument(help="What looks most like it comes first; a perception with a closed set refuses other words.")
]
Url = Annotated[str, typer.Option(envvar="SURVEILNAV_URL", help="The gateway.")]
DEFAULT_URL = "http://127.0.0.1:8080"


def _density(cameras: int | None, area_per_camera_m2: float | None, everywhere: bool) -> dict[str, Any]:
    """The camera plan's settings: a number, else an area, else four cameras."""
    if cameras is None and area_per_camera_m2 is None:
        cameras = DEFAULT_CAMERAS
    return {"cameras": cameras, "area_per_camera_m2": area_per_camera_m2 or 100.0, "cameras_everywhere": everywhere}


@app.command()
def demo(
    building: Building = "3_bedroom",
    seed: Seed = 0,
    target: Annotated[str, typer.Option(help="What to find, in words that the perception understands.")] = "tv",
    perception: Perception = BackendName.AUTO,
    surveillance: Annotated[OnOff, typer.Option(help="Whether cameras take part.")] = OnOff.on,
    cameras: Cameras = None,
    area_per_camera: Area = None,
    cameras_everywhere: Everywhere = False,
    max_steps: Annotated[int, typer.Option(min=1, max=5000)] = 500,
    record: Record = OnOff.on,
    runs: Annotated[Path, typer.Option(help="Where run folders go.")] = Path("runs"),
    as_json: AsJson = False,
) -> None:
    """Search a simulated home, end to end, and write a report. Exit 0 only if the stop was right."""
    from cli.demo import DemoOptions, run_demo

    options = DemoOptions(
        building=building, seed=seed, target=target, perception=perception.value, surveillance=surveillance is OnOff.on,
        **_density(cameras, area_per_camera, cameras_everywhere), max_steps=max_steps, runs=runs, record=record is OnOff.on,
    )  # fmt: skip
    outcome = run_demo(options, console)
    if as_json:
        print(json.dumps(outcome))
    raise typer.Exit(0 if outcome["success"] else 1)


@app.command()
def up(
    building: Building = "2_bedroom",
    seed: Seed = 0,
    perception: Perception = BackendName.AUTO,
    surveillance: Annotated[OnOff, typer.Option(help="Whether cameras take part.")] = OnOff.on,
    cameras: Cameras = None,
    area_per_camera: Area = None,
    cameras_everywhere: Everywhere = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="The gateway's port.")] = 8080,
    router: Annotated[str, typer.Option(help="The router's endpoint.")] = "tcp/127.0.0.1:7447",
    logs: Annotated[Path, typer.Option(help="Where the services' logs go.")] = Path("runs/up"),
    record: Record = OnOff.on,
) -> None:
    """Start router and services for a simulated home and keep them running until Ctrl-C."""
    from cli.up import run_up

    run_up(
        console, building=building, seed=seed, perception=perception.value, surveillance=surveillance is OnOff.on,
        **_density(cameras, area_per_camera, cameras_everywhere), port=port, router=router, logs=logs,
        record=record is OnOff.on,
    )  # fmt: skip


def _gateway(url: str) -> Client:
    """The client; imported where it is needed, as all that takes its time."""
    from surveilnav.client import Client

    return Client(url)


@app.command()
def find(
    target: str,
    robot: Annotated[str, typer.Option(help="A robot; empty: any free one.")] = "",
    max_steps: Annotated[int, typer.Option(min=1, max=5000)] = 500,
    queue: Annotated[bool, typer.Option("--queue", help="Wait for a robot if none is free.")] = False,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Send a robot of the running system to find TARGET. Exit 0 only if it was found."""
    from cli.remote import follow_mission

    with _gateway(url) as gateway:
        mission = follow_mission(gateway, target, robot, max_steps, console, queue=queue)
    if as_json:
        print(json.dumps(mission))
    raise typer.Exit(0 if mission.get("found") else 1)


@app.command()
def objects(
    text: Text = "",
    label: Annotated[str, typer.Option(help="Only objects that are called so.")] = "",
    floor: Annotated[str, typer.Option(help="Only those of one floor.")] = "",
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """List what the running system has seen; with TEXT, what looks most like it first."""
    from cli.remote import list_objects

    with _gateway(url) as gateway:
        list_objects(gateway, text, label, floor, results, as_json)


@app.command()
def status(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """What the running system is doing: services, robots, cameras, missions."""
    from cli.remote import system_status

    with _gateway(url) as gateway:
        system_status(gateway, results, as_json)


@app.command()
def stop(
    reason: Annotated[str, typer.Option(help="Why, for people.")] = "", url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """EMERGENCY STOP: stop all robots of the running system at once. Exit 0 only if each says that it stopped."""
    from cli.remote import stop_robots

    with _gateway(url) as gateway:
        stop_robots(gateway, reason, results, as_json)


@app.command()
def release(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Release all robots after `stop`. Nothing moves by that: missions stay paused until they are resumed."""
    from cli.remote import release_robots

    with _gateway(url) as gateway:
        release_robots(gateway, results, as_json)


@app.command()
def replay(
    file: Annotated[Path, typer.Argument(help="A recording (.mcap), also one that was cut off.")],
    speed: Annotated[float, typer.Option(min=0.01, max=1000, help="So many times as fast as it happened.")] = 1.0,
    port: Annotated[int, typer.Option(min=1, max=65535, help="The gateway's port.")] = 8080,
    check: Annotated[
        bool,
        typer.Option("--check", help="Only make the maps again and compare them. Exit 0 only if they are the same."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show a recorded search again, on the page and by REST, until Ctrl-C."""
    if not check:
        from cli.replay.play import run_replay

        run_replay(console, file, speed=speed, port=port)
        return
    from cli.replay.check import check as compare

    outcome = compare(file)
    if as_json:
        print(json.dumps(outcome.as_dict()))
    else:
        results.print(outcome.in_words(), markup=False)
    raise typer.Exit(0 if outcome.same else 1)


@app.command()
def doctor(
    building: Annotated[str, typer.Option(help="Also say how much of this building robots can reach.")] = "",
    as_json: AsJson = False,
) -> None:
    """Say what is missing on this machine, and how to get it."""
    from cli.doctor import examine, show

    findings = examine(building)
    if as_json:
        print(json.dumps({"findings": [f.as_dict() for f in findings]}))
    else:
        show(findings, results)
    raise typer.Exit(1 if any(f.level == "missing" for f in findings) else 0)


@app.command()
def buildings(as_json: AsJson = False) -> None:
    """List the buildings that can be simulated."""
    from simulator.sources import list_buildings

    rows = list_buildings()
    if as_json:
        print(json.dumps({"buildings": [asdict(row) for row in rows]}))
    else:
        for row in rows:
            results.print(f"[bold]{row.name}[/]  {row.about}")


@app.command()
def homes(folder: Annotated[Path, typer.Argument(help="A folder, or one file.")], as_json: AsJson = False) -> None:
    """Say of every plan and mesh in FOLDER how much of it robots can search. Exit 1 if nothing could be read.

    It takes .sh3d files, Home.xml, .glb, .gltf, .obj and folders of HM3D, however deep they lie.
    """
    from cli.homes import as_dict, look_at, show
    from cli.progress import counting

    with counting(console, "files") as progress:
        lines = look_at(folder, progress)
    if as_json:
        print(json.dumps({"folder": str(folder), "homes": [as_dict(line) for line in lines]}))
    else:
        show(lines, results)
    raise typer.Exit(0 if any(line.survey for line in lines) else 1)


@app.command()
def prepare() -> None:
    """Make once what every node of a simulated building needs: baked light, camera plan, camera views.

    The building comes from the environment (SURVEILNAV_SIM__BUILDING, ...): the first step of `docker compose up`.
    """
    from cli.progress import bar
    from simulator.simulation import SimulatedBuilding, SimulationSettings

    with bar(console) as progress:
        plan = SimulatedBuilding(SimulationSettings(), progress).prepare()
    console.print(f"{plan.building} is ready: {len(plan.cameras)} cameras")


def main() -> None:
    """The console script: a user's mistake is one line, never a traceback."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that whatever was started is stopped
    as_json = "--json" in sys.argv[1:]
    try:
        sys.exit(app(prog_name="surveilnav", standalone_mode=False) or 0)
    except (KeyboardInterrupt, typer.Abort):
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except Exception as error:
        usage = usage_of(error)
        words = usage if usage is not None else in_words(error)
        if words is None:
            raise
        if as_json:
            print(json.dumps(as_object(error, words)))
        if usage is not None:
            rich_format_error(error)  # type: ignore[arg-type]
            sys.exit(2)
        print(words, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
