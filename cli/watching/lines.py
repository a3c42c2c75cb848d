"""One event as a line."""

from __future__ import annotations

from surveilnav.cli.words import clock, metres
from surveilnav.client import ServerEvent
from surveilnav.rest import Event


def line_of(event: ServerEvent[Event]) -> str:
    """ "14:03:22  mission m-0123456789ab active  tv: exploring, step 61, to a frontier"."""
    data = event.data
    if event.kind == "reset":
        return f"{'':8}  what came before isn't known: {data.why or 'the gateway told nothing before'}"
    about = ", ".join(part for part in _about(event.kind, data) if part)
    return f"{clock(data.time)}  {event.kind} {data.id} {data.what}{'  ' if about else ''}{about}"


def _about(kind: str, data: Event) -> list[str]:
    message = data.message or ""
    if kind == "mission":
        return [f"{data.target}: {data.phase or data.state}", f"step {data.step or 0}", message]
    if kind == "object":
        where = " at " + ", ".join(metres(v) for v in data.center_m) if data.center_m else ""
        return [f"{data.label} on floor {data.floor}{where}", message]
    if kind == "service":
        return [f"{data.restarts} restarts" if data.restarts else "", message]
    return [f"floor {data.floor}" if data.floor else "", message]
