"""``surveilnav stop`` and ``surveilnav release``: the emergency stop of all robots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, items, print_json, results

if TYPE_CHECKING:
    from surveilnav.rest import RobotHalt


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
