"""``surveilnav traffic plan``: what a building's network will need."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import AsJson, print_result, results
from surveilnav.cli.words import human_bytes

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.traffic_forecast import Need


@needs("services")
def plan(
    cameras: Annotated[int, typer.Option(help="Cameras of the building.")],
    missions_per_hour: Annotated[float, typer.Option(help="Searches an hour, on average.")] = 6.0,
    tier: Annotated[
        str, typer.Option(help="What the cameras send: raw, jpeg+depth, jpeg, features, objects or auto.")
    ] = "jpeg+depth",
    views: Annotated[int, typer.Option(help="Views of each camera: 13 of a panoramic one, 1 of a fixed one.")] = 13,
    cameras_per_mission: Annotated[
        int, typer.Option(help="Cameras that a search invokes, which are those of its floors; 0: all.")
    ] = 0,
    robots: Annotated[int, typer.Option(help="Robots.")] = 1,
    hz: Annotated[
        float,
        typer.Option(
            help="How often a second the picture of an invoked view changes; 0: the cameras see what stands still."
        ),
    ] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Estimate how many bytes a building will need: of a search, and of an hour, with an interval."""
    from typing import cast, get_args

    from surveilnav.errors import ConfigError
    from surveilnav.messages import Tier, TierChoice
    from surveilnav.traffic_forecast import Plan, forecast, measured_costs

    if tier not in (choices := (*get_args(Tier), "auto")):
        raise ConfigError(f"expected a tier out of {', '.join(choices)}, got {tier!r}")
    wanted = Plan(cameras, cast(TierChoice, tier), missions_per_hour, views, cameras_per_mission, robots, hz)
    needs_by_link = forecast(wanted, measured_costs())
    print_result(
        {link: asdict(need) for link, need in needs_by_link.items()}, as_json, lambda: show(needs_by_link, results)
    )


def show(needs_by_link: dict[str, Need], console: Console) -> None:
    """A line for each kind of link."""
    columns = (
        Column("links", lambda row: row[0], "id"),
        Column("a search", lambda row: human_bytes(round(row[1].mission_bytes)), "number"),
        Column("an hour", lambda row: human_bytes(round(row[1].hour_bytes)), "number"),
        Column("nine of ten hours", _interval, "number"),
        Column("on average", lambda row: f"{8e-6 * row[1].hour_bytes / 3600:.3f} Mbit/s", "number"),
    )
    listing(console, columns, list(needs_by_link.items()))


def _interval(row: tuple[str, Need]) -> str:
    return f"{human_bytes(round(row[1].hour_low_bytes))} to {human_bytes(round(row[1].hour_high_bytes))}"
