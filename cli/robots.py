"""``surveilnav robots``, and ``surveilnav stop`` and ``release``: the emergency stop of all robots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli import robot_setup
from surveilnav.cli.completing import robot_ids
from surveilnav.cli.options import (
    DEFAULT_URL,
    AsJson,
    Url,
    gateway,
    items,
    only_before_nothing,
    print_json,
    print_result,
    results,
)
from surveilnav.cli.removing import FromMaps, Since, Until, known_or_as_typed, remove_from_maps

if TYPE_CHECKING:
    from surveilnav.rest import RobotHalt

app = typer.Typer(
    invoke_without_command=True,
    help="List robots; take what one has contributed out of the maps; check a real robot and find its map's place.",
)
app.command("check")(robot_setup.check)
app.command("frame")(robot_setup.frame)

Id = Annotated[
    str,
    typer.Argument(metavar="ID", autocompletion=robot_ids, help="A robot's id, or its beginning if that is unique."),
]


@app.callback()
def list_all(ctx: typer.Context, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """List robots: where they are and what they do; or take what one has contributed out of the maps."""
    from surveilnav.cli.status import show_robots

    only_before_nothing(ctx)
    if ctx.invoked_subcommand:
        return
    with gateway(url) as asked:
        found = asked.robots()
    print_result(items(found), as_json, lambda: show_robots(found, results))


@app.command()
def remove(
    id: Id,
    from_maps: FromMaps = False,
    since: Since = None,
    until: Until = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Take what a robot has contributed out of the maps, which --from-maps confirms. The robot goes on."""
    if not from_maps:
        raise typer.BadParameter(
            "a robot that left is shown as silent; to take what it saw out of the maps, add --from-maps"
        )
    with gateway(url) as asked:
        id = known_or_as_typed(asked, "robot", id, (robot.id for robot in asked.robots()))
        remove_from_maps(asked, f"robot/{id}", since, until, as_json)


def stop(
    reason: Annotated[str, typer.Option(metavar="TEXT", help="Reason, shown to people.")] = "",
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """EMERGENCY STOP: stop all robots of the running system at once. Exit 0 only if each confirms that it stopped."""
    with gateway(url) as asked:
        _tell(asked.stop_robots(reason), "stopped, until `surveilnav release`", as_json)


def release(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Release all robots after `stop`. They stay where they are until you resume their missions."""
    with gateway(url) as asked:
        _tell(asked.release_robots(), "released; its mission is paused until `surveilnav missions resume`", as_json)


def _tell(robots: list[RobotHalt], what: str, as_json: bool) -> None:
    if as_json:
        print_json(items(robots))
        return
    for robot in robots:
        results.print(f"{robot.robot}  {'not there' if robot.stale else what}", markup=False)
