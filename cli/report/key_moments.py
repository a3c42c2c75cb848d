"""The few steps of a search that tell it: for paper, and as chapters of the film."""

from __future__ import annotations

from typing import NamedTuple

from surveilnav.cli.report.film import Film
from surveilnav.cli.report.words import with_article
from surveilnav.messages import Plan
from surveilnav.words import canonical

_MAX_MOMENTS = 6
_GOES_FOR = {
    "target": "goes to the confirmed target",
    "candidate": "goes to what may be the target",
    "frontier": "goes to the edge of what is known",
    "stairs": "goes to the stairs",
    "second_look": "goes for a second look",
}


class KeyMoment(NamedTuple):
    """A frame of the film with a short title, a sentence on why, and the robot's view (WebP, empty if none is kept)."""

    frame: int
    title: str
    why: str
    view: bytes


def key_moments(film: Film, target: str) -> list[KeyMoment]:
    """At most six: the start, when something was first taken for the target, changes of mind, the end."""
    return [
        KeyMoment(i, f"Step {film.numbers[i]}: {title}", _why(film.plans[i]), film.pictures[i])
        for i, title in sorted(_titles(film, target).items())
    ]


def _titles(film: Film, target: str) -> dict[int, str]:
    """Frame number -> title."""
    last = len(film.steps) - 1
    titles = {0: "start"}
    if first := next((s for s in film.sightings if canonical(s.label) == canonical(target)), None):
        titles.setdefault(first.frame, f"something was taken for {with_article(target)} by {first.seen_by}")
    turns = [i for i in range(1, last) if _aim(film.plans[i]) not in (None, _aim(film.plans[i - 1]))]
    known = [i for i in turns if _kind(film.plans[i]) in ("target", "candidate", "stairs")]
    # What the robot went for in the end, then evenly from the others.
    wanted = [*known[-1:], *(turns[round(k * (len(turns) - 1) / 3)] for k in range(4) if turns)]
    for i in wanted:
        if len(titles) < _MAX_MOMENTS - 1:
            titles.setdefault(i, _GOES_FOR.get(_kind(film.plans[i]), "goes on"))
    titles[last] = "end" if last else titles[0]
    return titles


def _kind(plan: Plan | None) -> str:
    return plan.waypoint.kind if plan is not None and plan.waypoint is not None else ""


def _aim(plan: Plan | None) -> tuple[object, ...] | None:
    """What a plan goes for; an object stays the same while its place is made out better."""
    w = plan.waypoint if plan is not None else None
    if w is None:
        return None
    return (w.kind, w.object_id) if w.object_id is not None else (w.kind, round(w.x_m, 1), round(w.y_m, 1))


def _why(plan: Plan | None) -> str:
    if plan is None:
        return ""
    note = plan.waypoint.note if plan.waypoint is not None else ""
    return "; ".join(dict.fromkeys(s for s in (plan.why, note) if s))
