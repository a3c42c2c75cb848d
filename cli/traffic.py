"""``surveilnav traffic``: what cameras and robots cost, by the three numbers."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from operator import itemgetter
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli import traffic_plan
from surveilnav.cli.completing import known
from surveilnav.cli.listing import Cell, Column, facts, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, only_before_nothing, print_result, results
from surveilnav.cli.words import duration, human_bytes

#: Clocks that are off by more than this are named.
MAX_CLOCK_OFFSET_S = 1.0
#: Nodes are asked for newer counts no more often.
_WATCH_S = 5.0

if TYPE_CHECKING:
    from rich.console import Console

    from surveilnav.rest import LinkTraffic, MissionTraffic, SourceTraffic, Traffic


app = typer.Typer(
    invoke_without_command=True, help="Show what cameras and robots cost, and plan what a building will need."
)
app.command("plan")(traffic_plan.plan)


@app.callback()
def traffic(
    ctx: typer.Context,
    nodes: Annotated[bool, typer.Option("--nodes", help="Show every process of the system, too.")] = False,
    mission: Annotated[
        str, typer.Option(metavar="ID", help="Show instead what this mission has cost, and what it may come to.")
    ] = "",
    watch: Annotated[
        bool, typer.Option("--watch", help="Show until Ctrl-C what goes over each kind of link, a line every 5 s.")
    ] = False,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show how many bytes each camera and robot offered, how many were delivered, and how many went over the wire."""
    only_before_nothing(ctx)
    if ctx.invoked_subcommand:
        return
    with gateway(url) as asked:
        if mission:
            cost = asked.mission_traffic(known(asked, "mission", mission))
            print_result(cost, as_json, lambda: show_cost(cost, results))
        elif watch:
            with suppress(KeyboardInterrupt):  # as it is meant to end
                for rates in watched_rates(asked.traffic, time.sleep, time.monotonic):
                    print_result(rates, as_json, lambda rates=rates: results.print(rate_line(rates)))  # type: ignore[misc]
        else:
            found = asked.traffic()
            print_result(found, as_json, lambda: show_traffic(found, results, nodes=nodes))


def watched_rates(
    ask: Callable[[], Traffic], sleep: Callable[[float], None], clock: Callable[[], float]
) -> Iterator[dict[str, float]]:
    """What is offered a second on each kind of link [B/s], again and again: "camera", "robot", "server", "simulation"."""
    before, before_s = ask().links, clock()
    while True:
        sleep(_WATCH_S)
        now, now_s = ask().links, clock()
        # a service that was started again counts from 0
        moved = {name: max(0, n - getattr(before, name)) for name, n in now.model_dump().items()}
        yield {name.removesuffix("_bytes"): n / (now_s - before_s) for name, n in moved.items()}
        before, before_s = now, now_s


def rate_line(rates: Mapping[str, float]) -> str:
    """The rates of all links in one line, without the simulator's."""
    shown = ((link, human_bytes(round(rate))) for link, rate in rates.items() if link != "simulation")
    return "   ".join(f"{link} links {rate:>8}/s" for link, rate in shown)


def show_cost(cost: MissionTraffic, console: Console) -> None:
    """What cameras and robots sent while a mission ran."""
    most, step = cost.at_most_bytes, cost.per_step_bytes
    facts(
        console,
        [
            ("mission", cost.mission),
            ("offered", human_bytes(cost.offered_bytes)),
            ("delivered", human_bytes(cost.delivered_bytes)),
            ("wire", human_bytes(cost.wire_sent_bytes)),
            ("on links", link_words(cost.links)),
            ("a step", "" if step is None else human_bytes(round(step))),
            ("at most", "" if most is None else f"{human_bytes(round(most))}, if it uses all its steps"),
            ("note", "" if cost.alone else "other missions ran meanwhile: nobody can tell what was for which"),
            ("note", "" if cost.whole else "the gateway came later than the mission: what was before isn't counted"),
        ],
    )


def show_traffic(found: Traffic, console: Console, *, nodes: bool = False) -> None:
    """A line for each camera and robot, then the sum; ``nodes``: processes, too."""
    titles = ("offered", "delivered", "wire", "pictures", "for viewers")
    numbers = (Column(title, itemgetter(i), "number") for i, title in enumerate(titles, 1))
    columns = (Column("source", itemgetter(0), "id"), *numbers)
    rows: list[list[Cell]] = [_source("camera", c) for c in found.cameras] + [_source("robot", r) for r in found.robots]
    total = [found.offered_bytes, found.delivered_bytes, found.wire_sent_bytes]
    listing(console, columns, [*rows, [("all processes", "bold"), *(human_bytes(n) for n in total), "", ""]])
    console.print(f"offered on links: {link_words(found.links)}")
    tiers: Counter[str] = Counter()
    for camera in found.cameras:
        tiers.update(camera.tier_bytes)
    if tiers:
        console.print("frames of cameras: " + ", ".join(f"{tier} {human_bytes(n)}" for tier, n in tiers.most_common()))
    replaced, missing = (sum(getattr(s, f"{what}_bytes") for s in found.cameras) for what in ("replaced", "missing"))
    if replaced or missing:
        console.print(
            f"of these {human_bytes(replaced)} were replaced by newer ones before they were read, and {human_bytes(missing)} "
            "are on their way or were dropped by a full link"
        )
    if nodes:
        console.print()
        _show_nodes(found, console)


def link_words(links: LinkTraffic) -> str:
    """The bytes of all links, without the simulator's."""
    named = (("cameras", links.camera_bytes), ("robots", links.robot_bytes), ("servers", links.server_bytes))
    return ", ".join(f"{name} {human_bytes(n)}" for name, n in named)


def _source(kind: str, source: SourceTraffic) -> list[Cell]:

    counts = [source.offered_bytes, source.delivered_bytes, source.wire_sent_bytes, source.frame_bytes]
    name = f"{kind}/{source.id}"
    return [(name, "yellow" if source.stale else ""), *map(human_bytes, [*counts, source.viewer_bytes])]


def clock_words(offset_s: float | None) -> tuple[str, str]:
    """What is to be said of a clock, and its colour; nothing if it is right to a second."""
    if offset_s is None or abs(offset_s) <= MAX_CLOCK_OFFSET_S:
        return "", ""
    return f"{duration(abs(offset_s))} {'ahead' if offset_s > 0 else 'behind'}", "red"


def _show_nodes(found: Traffic, console: Console) -> None:
    columns = (
        Column("process", lambda n: f"{n.kind}/{n.id}", "id"),
        Column("offered", lambda n: human_bytes(n.offered_bytes), "number"),
        Column("delivered", lambda n: human_bytes(n.delivered_bytes), "number"),
        Column("wire out", lambda n: human_bytes(n.wire_sent_bytes), "number"),
        Column("wire in", lambda n: human_bytes(n.wire_received_bytes), "number"),
        Column("clock", lambda n: clock_words(n.clock_offset_s)),
        Column("refused", lambda n: str(sum(n.rejected.values())), "number"),
    )
    listing(console, columns, found.nodes)
