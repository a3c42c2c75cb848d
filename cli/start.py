"""``surveilnav demo``, ``up`` and ``prepare``: what simulates a building."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cli.options import (
    Area,
    AsJson,
    Building,
    Cameras,
    Everywhere,
    MaxSteps,
    OnOff,
    Perception,
    Seed,
    Surveillance,
    console,
    density,
    print_json,
)
from surveilnav.perception.names import BackendName


def demo(
    building: Building = "3_bedroom",
    seed: Seed = 0,
    target: Annotated[
        str, typer.Option(metavar="WORDS", help="What to find, in words that the perception understands.")
    ] = "tv",
    perception: Perception = BackendName.AUTO,
    surveillance: Surveillance = OnOff.on,
    cameras: Cameras = None,
    area_per_camera: Area = None,
    cameras_everywhere: Everywhere = False,
    max_steps: MaxSteps = 500,
    runs: Annotated[Path, typer.Option(metavar="FOLDER", help="Where run folders go.")] = Path("runs"),
    as_json: AsJson = False,
) -> None:
    """Search a simulated home, end to end, and write a report. Exit 0 only if the stop was right."""
    from cli.demo import DemoOptions, run_demo

    options = DemoOptions(
        building=building, seed=seed, target=target, perception=perception.value, surveillance=surveillance is OnOff.on,
        **density(cameras, area_per_camera, cameras_everywhere), max_steps=max_steps, runs=runs,
    )  # fmt: skip
    outcome = run_demo(options, console)
    if as_json:
        print_json(outcome)
    raise typer.Exit(0 if outcome["success"] else 1)


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
    logs: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the services' logs go.")] = Path("runs/up"),
) -> None:
    """Start router and services for a simulated home and keep them running until Ctrl-C."""
    from cli.up import run_up

    run_up(
        console, building=building, seed=seed, perception=perception.value, surveillance=surveillance is OnOff.on,
        **density(cameras, area_per_camera, cameras_everywhere), port=port, router=router, logs=logs,
    )  # fmt: skip


def prepare() -> None:
    """Make once what every node of a simulated building needs: baked light, camera plan, camera views.

    The building comes from the environment (SURVEILNAV_SIM__BUILDING, ...): the first step of `docker compose up`.
    """
    from cli.progress import bar
    from simulator.simulation import SimulatedBuilding, SimulationSettings

    with bar(console) as progress:
        plan = SimulatedBuilding(SimulationSettings(), progress).prepare()
    console.print(f"{plan.building} is ready: {len(plan.cameras)} cameras")
