"""``surveilnav status``: what a running system is doing, all of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.padding import Padding
from rich.text import Text

from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, items, print_result, results
from surveilnav.cli.terminal import plain
from surveilnav.cli.traffic import MAX_CLOCK_OFFSET_S, clock_words
from surveilnav.cli.words import clock, why_perceived

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from surveilnav.client import Client
    from surveilnav.rest import Service


def status(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Show what the running system is doing: services, robots, cameras, perception, missions, removals from the maps."""
    with gateway(url) as asked:
        found = everything(asked)
    print_result({name: items(rows) for name, rows in found.items()}, as_json, lambda: show_status(found, results))


def everything(asked: Client) -> dict[str, list[Any]]:
    """The gateway's lists by name."""
    found: dict[str, list[Any]] = {
        "services": list(asked.services()),
        "robots": list(asked.robots()),
        "cameras": list(asked.cameras()),
        "perception": list(asked.perception()),
        "missions": list(asked.missions()),
        "removals": list(asked.removals()),
    }
    nodes = asked.traffic().nodes
    wrong = [n for n in nodes if not n.stale and abs(n.clock_offset_s or 0.0) > MAX_CLOCK_OFFSET_S]
    if wrong:
        found["wrong_clocks"] = wrong
    if strangers := [n for n in nodes if not n.stale and n.other_release]:
        found["other_releases"] = strangers
    hindered = [n for n in nodes if not n.stale and n.problems]
    if hindered:
        found["problems"] = hindered
    return found


def show_status(found: dict[str, list[Any]], console: Console) -> None:
    """A table for each of the lists; what robots can't reach below theirs."""
    from surveilnav.cli.cameras import show_cameras
    from surveilnav.cli.mission_words import show_missions

    show: dict[str, Callable[[list[Any], Console], None]] = {
        "services": _services,
        "robots": show_robots,
        "cameras": show_cameras,
        "perception": _workers,
        "missions": show_missions,
        "wrong_clocks": _clocks,
        "other_releases": _releases,
        "problems": _problems,
        "removals": _removals,
    }
    for name, rows in found.items():
        if name == "removals" and not rows:
            continue
        console.print(f"[bold]{name.replace('_', ' ')}[/] ({len(rows)})")
        if rows:
            show[name](rows, console)


def _services(rows: list[Any], console: Console) -> None:
    columns = (
        Column("service", lambda s: s.id, "id"),
        Column("state", service_state),
        Column("restarts", lambda s: str(s.restarts), "number"),
        Column("last", lambda s: clock(s.restarted), "number"),
        Column("why", lambda s: s.why or "", "note"),
    )
    listing(console, columns, rows)


def service_state(service: Service) -> tuple[str, str]:
    """What became of a process that is kept running, and its colour."""
    if service.given_up:
        return "given up", "red"
    return ("runs", "") if service.running else ("ended", "red")


def _clocks(rows: list[Any], console: Console) -> None:
    columns = (
        Column("process", lambda n: f"{n.kind}/{n.id}", "id"),
        Column("clock", lambda n: clock_words(n.clock_offset_s)),
    )
    listing(console, columns, rows)


def _releases(rows: list[Any], console: Console) -> None:
    """Nodes that don't run the gateway's release: they work as long as they speak its contract, and should be replaced."""
    columns = (
        Column("process", lambda n: f"{n.kind}/{n.id}", "id"),
        Column("release", lambda n: n.release or "unknown"),
    )
    listing(console, columns, rows)


def _problems(rows: list[Any], console: Console) -> None:
    for node in rows:
        for what, why in node.problems.items():
            console.print(plain(f"  {node.kind}/{node.id}, {what}: {why}"), markup=False, soft_wrap=True, style="red")


def show_robots(rows: list[Any], console: Console) -> None:
    columns = (
        Column("robot", lambda r: r.id, "id"),
        Column("floor", lambda r: r.floor, "id"),
        Column("at x, y [m]", lambda r: f"{r.position_m[0]:.1f}, {r.position_m[1]:.1f}", "number"),
        Column("state", lambda r: ("silent", "red") if r.stale else r.state),
        Column("battery", lambda r: "-" if r.battery is None else f"{r.battery:.0%}", "number"),
        Column("mission", lambda r: r.mission or "-", "id"),
        Column("message", lambda r: r.message, "note"),
    )
    if rows:
        listing(console, columns, rows)
    for row in rows:
        if row.frame_problem:
            console.print(plain(row.frame_problem), markup=False, style="red", soft_wrap=True)
        for note in row.notes:
            console.print(Padding(Text(plain(f"note: {note}")), (0, 0, 0, 2)))


def _removals(rows: list[Any], console: Console) -> None:
    from surveilnav.cli.removing import in_words

    for removal in rows:
        console.print(f"  {in_words(removal)}", markup=False, soft_wrap=True)


def _workers(rows: list[Any], console: Console) -> None:
    columns = (
        Column("worker", lambda w: w.id, "id"),
        Column("backend", lambda w: w.backend),
        Column("state", lambda w: ("silent", "red") if w.stale else "ready" if w.ready else ("not ready", "yellow")),
        Column("queue", lambda w: f"{w.queued}/{w.capacity}", "number"),
        Column("why", lambda w: why_perceived(w.why, w.calibrated), "note"),
    )
    listing(console, columns, rows)
