"""``surveilnav status``: what a running system is doing, all of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.padding import Padding
from rich.text import Text

from surveilnav.cli.listing import Column, listing
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, gateway, items, print_json, results
from surveilnav.cli.terminal import plain
from surveilnav.cli.words import clock, why_perceived

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from surveilnav.client import Client
    from surveilnav.rest import Service


def status(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Show what the running system is doing: services, robots, cameras, perception, missions."""
    with gateway(url) as asked:
        found = everything(asked)
    if as_json:
        print_json({name: items(rows) for name, rows in found.items()})
    else:
        show_status(found, results)


def everything(asked: Client) -> dict[str, list[Any]]:
    """The gateway's lists by name."""
    return {
        "services": list(asked.services()),
        "robots": list(asked.robots()),
        "cameras": list(asked.cameras()),
        "perception": list(asked.perception()),
        "missions": list(asked.missions()),
    }


def show_status(found: dict[str, list[Any]], console: Console) -> None:
    """A table for each of the lists; what robots can't reach below theirs."""
    from surveilnav.cli.cameras import show_cameras
    from surveilnav.cli.mission_words import show_missions

    show: dict[str, Callable[[list[Any], Console], None]] = {
        "services": _services,
        "robots": _robots,
        "cameras": show_cameras,
        "perception": _workers,
        "missions": show_missions,
    }
    for name, rows in found.items():
        console.print(f"[bold]{name}[/] ({len(rows)})")
        if rows:
            show[name](rows, console)


def _services(rows: list[Any], console: Console) -> None:

    columns = (
        Column("service", "id"),
        Column("state"),
        Column("restarts", "number"),
        Column("last", "number"),
        Column("why", "note"),
    )
    listing(
        console,
        columns,
        [[s.id, service_state(s), str(s.restarts), clock(s.restarted), s.why or ""] for s in rows],
    )


def service_state(service: Service) -> tuple[str, str]:
    """What became of a process that is kept running, and its colour."""
    if service.given_up:
        return "given up", "red"
    return ("runs", "") if service.running else ("ended", "red")


def _robots(rows: list[Any], console: Console) -> None:
    columns = (
        Column("robot", "id"),
        Column("floor", "id"),
        Column("at x, y [m]", "number"),
        Column("state"),
        Column("mission", "id"),
        Column("message", "note"),
    )
    listing(
        console,
        columns,
        [
            [
                r.id,
                r.floor,
                f"{r.position_m[0]:.1f}, {r.position_m[1]:.1f}",
                ("silent", "red") if r.stale else r.state,
                r.mission or "-",
                r.message,
            ]
            for r in rows
        ],
    )
    for row in rows:
        for note in row.notes:
            console.print(Padding(Text(plain(f"note: {note}")), (0, 0, 0, 2)))


def _workers(rows: list[Any], console: Console) -> None:

    columns = (
        Column("worker", "id"),
        Column("backend"),
        Column("state"),
        Column("queue", "number"),
        Column("why", "note"),
    )
    listing(
        console,
        columns,
        [
            [
                w.id,
                w.backend,
                ("silent", "red") if w.stale else "ready" if w.ready else ("not ready", "yellow"),
                f"{w.queued}/{w.capacity}",
                why_perceived(w.why, w.calibrated),
            ]
            for w in rows
        ],
    )
