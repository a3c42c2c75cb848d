"""Missions and plans as people read them."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from surveilnav.cli.listing import Cell, Column, facts, listing
from surveilnav.cli.words import clock, duration, metres
from surveilnav.rest import Mission, MissionPlan, Place

_COLOURS = {"active": "cyan", "confirming": "cyan", "paused": "yellow", "queued": "yellow", "failed": "red"}


def state_of(mission: Mission) -> tuple[str, str]:
    """A mission's state and its colour; a mission whose planner is gone says so."""
    if mission.stale:
        return f"{mission.state}?", "yellow"
    if mission.state == "done":
        return "done", "green" if mission.found else "red"
    return mission.state, _COLOURS.get(mission.state, "")


def _judged(mission: Mission) -> Cell:
    """What the simulator says of the robot's stop, if the building is simulated."""
    if mission.judged is None:
        return ""
    return ("agrees: it stopped where it should", "green") if mission.judged else ("disagrees: that isn't one", "red")


def steps_of(mission: Mission) -> str:
    """ "61/500"."""
    most = mission.max_steps
    return f"{mission.step}/{most}" if most else str(mission.step)


def said_of(mission: Mission) -> str:
    """What there is to say of it: the failure's name, and its message."""
    return ": ".join(text for text in (mission.error, mission.message) if text)


def show_missions(missions: Sequence[Mission], console: Console) -> None:
    """A line a mission."""
    if not missions:
        console.print("no mission yet; `surveilnav find TARGET` sends a robot")
        return
    columns = (
        Column("id", lambda m: m.id, "id"),
        Column("state", state_of),
        Column("target", lambda m: m.target, "text"),
        Column("robot", lambda m: m.robot or "-", "id"),
        Column("step", steps_of, "number"),
        Column("way", lambda m: metres(m.path_m), "number"),
        Column("message", said_of, "note"),
    )
    listing(console, columns, missions)


def show_mission(mission: Mission, plan: MissionPlan | None, console: Console) -> None:
    """All that is known of one, and its plan."""
    asked = f" (asked for: {mission.asked})" if mission.asked else ""
    left = duration(mission.time_remaining_s)
    facts(
        console,
        [
            ("mission", mission.id),
            ("target", mission.target + asked),
            ("state", state_of(mission)),
            ("found", "yes" if mission.found else ""),
            ("the simulator", _judged(mission)),
            ("why", said_of(mission)),
            ("robot", mission.robot or "none yet"),
            ("floor", mission.floor or ""),
            ("phase", mission.phase),
            ("step", steps_of(mission)),
            ("way so far", metres(mission.path_m)),
            ("to waypoint", metres(mission.distance_remaining_m)),
            ("time left", f"{left} to the waypoint" if left else ""),
            ("took", duration(mission.elapsed_s)),
            ("started", clock(mission.started)),
            ("finished", clock(mission.finished)),
            ("last heard of", clock(mission.last_seen) + (", its planner is gone" if mission.stale else "")),
        ],
    )
    if plan:
        console.print()
        show_plan(plan, console)


def show_plan(plan: MissionPlan, console: Console) -> None:
    """Why the robot does what it does, and what else was weighed."""
    console.print(f"step {plan.step}, floor {plan.floor}: {plan.action}, {plan.why}", markup=False)
    if not plan.candidates:
        return
    columns = (
        Column("weighed", lambda p: (p.kind if p.object_id is None else f"{p.kind} {p.object_id}", _style(p))),
        Column("at", lambda p: ", ".join("?" if v is None else f"{v:.1f}" for v in (p.x_m, p.y_m)), "number"),
        Column("chance", lambda p: "" if p.chance is None else f"{p.chance:.0%}", "number"),
        Column("way", lambda p: metres(p.cost_m), "number"),
        Column("utility", lambda p: "" if p.utility is None else f"{p.utility:.3g}", "number"),
        Column("note", lambda p: (("chosen: " if p.chosen else "") + p.note, _style(p)), "note"),
    )
    listing(console, columns, plan.candidates)


def _style(place: Place) -> str:
    return "green" if place.chosen else ""
