"""``surveilnav find`` and ``surveilnav missions``: searches of a running system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.completing import known, mission_ids
from surveilnav.cli.options import (
    DEFAULT_URL,
    AsJson,
    MaxSteps,
    Url,
    console,
    gateway,
    items,
    only_before_nothing,
    print_json,
    print_result,
    results,
)

if TYPE_CHECKING:
    from surveilnav.client import Client
    from surveilnav.rest import Mission, MissionPlan

app = typer.Typer(invoke_without_command=True, help="List missions; show, cancel, pause or resume one.")


Id = Annotated[
    str,
    typer.Argument(
        metavar="ID", autocompletion=mission_ids, help="A mission's id, or its beginning if that is unique."
    ),
]
Reason = Annotated[str, typer.Option(metavar="TEXT", help="Reason, shown to people.")]


def find(
    target: Annotated[str, typer.Argument(help="What to find, in words that the perception backend understands.")],
    robot: Annotated[str, typer.Option(metavar="ID", help="The robot to send; by default any free one.")] = "",
    max_steps: MaxSteps = 500,
    queue: Annotated[bool, typer.Option("--queue", help="Wait for a robot if none is free.")] = False,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Send a robot of the running system to find TARGET, and follow it. Exit 0 only if it found it."""
    from surveilnav.cli.following import follow_mission

    with gateway(url) as asked:
        mission = follow_mission(asked, target, robot, max_steps, console, queue=queue)
    if as_json:
        print_json(mission)
    raise typer.Exit(0 if mission.found else 1)


@app.callback()
def list_all(ctx: typer.Context, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """List missions, newest first; or show, cancel, pause or resume one."""
    only_before_nothing(ctx)
    if ctx.invoked_subcommand:
        return
    from surveilnav.cli.mission_words import show_missions

    with gateway(url) as asked:
        missions = asked.missions()
    print_result(items(missions), as_json, lambda: show_missions(missions, results))


@app.command()
def show(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Show everything known about a mission, and what its robot is doing."""
    from surveilnav.cli.mission_words import show_mission

    with gateway(url) as asked:
        mission = asked.mission(known(asked, "mission", id))
        print_result(mission, as_json, lambda: show_mission(mission, _plan_of(asked, mission), results))


@app.command()
def why(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Show what the robot could do next, with chance, cost and utility of each option, and why it does what it does."""
    from surveilnav.cli.mission_words import show_plan

    with gateway(url) as asked:
        found = asked.plan(known(asked, "mission", id))
    print_result(found, as_json, lambda: show_plan(found, results))


@app.command()
def cancel(id: Id, reason: Reason = "", url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Cancel a mission; its robot stops."""
    with gateway(url) as asked:
        _changed(asked.cancel(known(asked, "mission", id), reason), as_json)


@app.command()
def pause(id: Id, reason: Reason = "", url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Pause a mission: its robot finishes its action and stays where it is."""
    with gateway(url) as asked:
        _changed(asked.pause(known(asked, "mission", id), reason), as_json)


@app.command()
def resume(id: Id, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Resume a paused mission."""
    with gateway(url) as asked:
        _changed(asked.resume(known(asked, "mission", id)), as_json)


def _changed(mission: Mission, as_json: bool) -> None:
    told = f"{mission.id}: {mission.state}"
    print_result(mission, as_json, lambda: results.print(told, markup=False, soft_wrap=True))


def _plan_of(asked: Client, mission: Mission) -> MissionPlan | None:
    """What its robot is up to; None if there is no plan, or no longer."""
    from surveilnav.errors import GatewayError

    if mission.has_ended:
        return None
    try:
        return asked.plan(mission.id)
    except GatewayError:
        return None
