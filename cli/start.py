"""``surveilnav demo``, ``up`` and ``prepare``: what simulates a building."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.options import (
    BUILDING_KINDS,
    Area,
    AsJson,
    Building,
    Cameras,
    Everywhere,
    MaxSteps,
    OnOff,
    Perception,
    Record,
    Seed,
    Surveillance,
    console,
    density,
    print_json,
    results,
)
from surveilnav.perception.names import BackendName


@needs("simulator")
def demo(
    building: Building = "3_bedroom",
    seed: Seed = 0,
    target: Annotated[
        str, typer.Option(metavar="WORDS", help="What to find, in words that the perception backend understands.")
    ] = "tv",
    perception: Perception = BackendName.AUTO,
    surveillance: Surveillance = OnOff.on,
    cameras: Cameras = None,
    area_per_camera: Area = None,
    cameras_everywhere: Everywhere = False,
    max_steps: MaxSteps = 500,
    record: Record = OnOff.on,
    runs: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder in which each run gets a folder.")] = Path(
        "runs"
    ),
    as_json: AsJson = False,
) -> None:
    """Search a simulated home once and write a report. Exit 0 only if the robot stopped at the target."""
    from surveilnav.cli.demo import DemoOptions, run_demo

    options = DemoOptions(
        building=building,
        seed=seed,
        target=target,
        perception=perception.value,
        surveillance=surveillance is OnOff.on,
        **density(cameras, area_per_camera, cameras_everywhere),
        max_steps=max_steps,
        runs=runs,
        record=record is OnOff.on,
    )
    outcome = run_demo(options, console)
    if as_json:
        print_json(outcome)
    raise typer.Exit(0 if outcome["success"] else 1)


@needs("simulator")
def up(
    building: Building = "2_bedroom",
    seed: Seed = 0,
    perception: Perception = BackendName.AUTO,
    surveillance: Surveillance = OnOff.on,
    cameras: Cameras = None,
    area_per_camera: Area = None,
    cameras_everywhere: Everywhere = False,
    port: Annotated[int, typer.Option(min=1, max=65535, metavar="N", help="The gateway's port.")] = 8080,
    router: Annotated[str, typer.Option(metavar="ENDPOINT", help="The router's endpoint.")] = "tcp/127.0.0.1:7447",
    logs: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of the services' logs.")] = Path("runs/up"),
    record: Record = OnOff.on,
    security: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Encrypt the bus, and give each process its identity from this folder of `surveilnav security init`.",
        ),
    ] = None,
    as_real: Annotated[
        bool,
        typer.Option(
            "--as-real",
            help="Run the building's cameras and robot as hardware, which the services meet by RTSP and ROS 2 alone.",
        ),
    ] = False,
) -> None:
    """Start the router and all services for a simulated building, and keep them running until Ctrl-C."""
    from surveilnav.cli.up import run_up

    run_up(
        console,
        building=building,
        seed=seed,
        perception=perception.value,
        surveillance=surveillance is OnOff.on,
        **density(cameras, area_per_camera, cameras_everywhere),
        port=port,
        router=router,
        logs=logs,
        record=record is OnOff.on,
        security=security,
        as_real=as_real,
    )


@needs("simulator")
def prepare(
    building: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=f"Which building: {BUILDING_KINDS}; by default that of the environment."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Chooses furniture models, textures and sensor noise.")
    ] = None,
    perception: Perception = BackendName.AUTO,
    cameras: Cameras = None,
    area_per_camera: Area = None,
    cameras_everywhere: Everywhere = False,
    no_models: Annotated[bool, typer.Option("--no-models", help="Don't download models.")] = False,
    no_loops: Annotated[
        bool, typer.Option("--no-loops", help="Don't compile the inner loops (which takes a small search).")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Compute and download ahead what a first search needs: furniture, light, camera views, navigation, models.

    It also compiles the inner loops. Afterwards no network is needed, and `demo` and `up` with the same options start at once.
    Without --building all options come from the environment (SURVEILNAV_SIM__BUILDING, ...), as in `docker compose up`.
    """
    from surveilnav.cli.preparing import run_prepare
    from surveilnav.simulator.simulation import SimulationSettings

    if building is not None:  # as `demo` and `up` have it, so that they find the same plan
        said: dict[str, Any] = {"building": building, "seed": seed or 0}
        said |= density(cameras, area_per_camera, cameras_everywhere)
    else:
        named = {"seed": seed, "cameras": cameras, "area_per_camera_m2": area_per_camera}
        said = {name: value for name, value in named.items() if value is not None}
        said |= {"cameras_everywhere": True} if cameras_everywhere else {}
    settings = SimulationSettings(**said)
    ready = run_prepare(settings, "" if no_models else perception.value, console, loops=not no_loops)
    if as_json:
        print_json(ready.as_dict())
        return
    for note in ready.notes:
        console.print(f"note: {note}", markup=False)
    results.print(f"{ready.building} is ready: {len(ready.cameras)} cameras", markup=False)
    if ready.backend:
        results.print(f"perception: {ready.backend} ({ready.why})", markup=False)
