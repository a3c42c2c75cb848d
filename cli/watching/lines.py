"""One event as a line."""

from __future__ import annotations

from surveilnav.cli.words import clock, metres
from surveilnav.client.events import Told


def line_of(told: Told) -> str:
    """ "14:03:22  mission m-0123456789ab active  tv: exploring, step 61, to a frontier"."""
    data = told.data
    if told.kind == "reset":
        return f"{'':8}  what came before isn't known: {data.get('why', 'the gateway told nothing before')}"
    about = ", ".join(part for part in _about(told) if part)
    return f"{clock(data.get('time'))}  {told.kind} {data['id']} {data['what']}{'  ' if about else ''}{about}"


def _about(told: Told) -> list[str]:
    data = told.data
    message = data.get("message") or ""
    if told.kind == "mission":
        return [
            f"{data.get('target')}: {data.get('phase') or data.get('state')}",
            f"step {data.get('step', 0)}",
            message,
        ]
    if told.kind == "object":
        at = data.get("center_m") or []
        where = " at " + ", ".join(metres(v) for v in at) if at else ""
        return [f"{data.get('label')} on floor {data.get('floor')}{where}", message]
    if told.kind == "service":
        restarts = data.get("restarts")
        return [f"{restarts} restarts" if restarts else "", message]
    return [f"floor {data['floor']}" if data.get("floor") else "", message]
