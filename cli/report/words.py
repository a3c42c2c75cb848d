"""A run in plain words."""

from __future__ import annotations

from typing import Literal

from surveilnav.cli.report.record import RunRecord, first_seen_by
from surveilnav.cli.words import duration

Tone = Literal["good", "half", "bad"]

_FAILURES = {
    "not_found": "everything that it could reach was searched, and nothing passed for one",
    "unreachable": "there is no way to it",
    "out_of_steps": "the robot ran out of steps",
    "robot_lost": "the robot was lost",
    "perception_down": "perception was down",
    "fusion_down": "the maps' service was down",
    "stuck": "the robot was stuck",
    "superseded": "the robot was given another search",
    "mission_lost": "the planner's store was lost",
    "bad_target": "this isn't a target that can be searched for",
}


def outcome(record: RunRecord) -> tuple[Tone, str]:
    """How the run ended, in one sentence."""
    target, effort = record.target, _effort(record)
    after = f" after {effort}" if effort else ""
    if record.success:
        room = f" in the {room_words(record.room)}" if record.room.strip() else ""
        return "good", f"The robot found the {target}{room}{after}{_who_was_first(record)}."
    if record.found:
        away = record.number("distance_to_viewpoint_m")
        how = f": it is {away:.1f} m from the nearest place that counts" if away is not None else ""
        return "half", f"The robot stopped for {with_article(target)}{after}, but the simulator's check says no{how}."
    status = record.status
    if status is None:
        return "bad", f"The run ended before its search for {with_article(target)} had a status."
    if status.state == "cancelled":
        return "bad", f"The search for {with_article(target)} was cancelled{after}."
    if status.state not in ("failed", "done"):
        how = f"it was {status.state} ({status.phase})"
        return "bad", f"The search for {with_article(target)} didn't end: {how}{after}."
    why = _FAILURES.get(status.error, status.error.replace("_", " ") or "no reason was given")
    spent = f" in {effort}" if effort else ""
    return "bad", f"The robot didn't find {with_article(target)}{spent}: {why}."


def judgement(record: RunRecord) -> str:
    """What the simulator says of a stop that was right; empty otherwise."""
    steps, shortest = record.number("steps"), record.number("shortest_path_m")
    if not record.success:
        return ""
    after = f" after {steps:.0f} steps" if steps is not None else ""
    best = f" The shortest way is {shortest:.1f} m." if shortest is not None else ""
    return f"It stopped where it should{after}: the simulator agrees.{best}"


def with_article(noun: str) -> str:
    """ "a tv", "an oven"."""
    return f"{'an' if noun[:1].lower() in tuple('aeiou') else 'a'} {noun}"


def room_words(name: str) -> str:
    """A room's name within a sentence: "Living room" is written "living room", "WC" stays."""
    name = " ".join(name.replace("_", " ").split())[:40]
    return name[:1].lower() + name[1:] if name[1:] == name[1:].lower() else name


def _effort(record: RunRecord) -> str:
    """The way and the time, as far as they are known: "31 m and 2 min 10 s"."""
    path_m, seconds = record.number("path_m"), record.search_s
    parts = [f"{path_m:.1f} m" if path_m < 9.95 else f"{path_m:.0f} m"] if path_m is not None else []
    return " and ".join([*parts, *([duration(seconds)] if seconds is not None else [])])


def _who_was_first(record: RunRecord) -> str:
    """Whether a camera had seen the object before the robot."""
    chosen = record.chosen
    first = first_seen_by(chosen) if chosen is not None else ""
    return f"; camera {first.removeprefix('camera/')} had seen it first" if first.startswith("camera/") else ""
