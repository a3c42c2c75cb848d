"""The few steps of a search that tell it: for paper, and as chapters of the film strip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from surveilnav.cli.report.cell_changes import EXPLORED, OBSTACLE, GrowingMap
from surveilnav.cli.report.film import Film
from surveilnav.cli.report.floor_map import PATH
from surveilnav.cli.report.record import Step
from surveilnav.cli.report.svg import data_uri, drawing, tag
from surveilnav.cli.report.words import with_article
from surveilnav.messages import Candidate, Plan
from surveilnav.services.gateway.core.layers import COLOURS, encode_png
from surveilnav.words import canonical

_MOST = 6
_GOES_FOR = {
    "target": "goes to the confirmed target",
    "candidate": "goes to what may be the target",
    "frontier": "goes to the edge of what is known",
    "stairs": "goes to the stairs",
    "second_look": "goes for a second look",
}


class KeyMoment(NamedTuple):
    """Frame number, a short title, a sentence on why, the robot's view (an address that holds it), the map as SVG."""

    frame: int
    title: str
    why: str
    view: str
    map: Markup | None


def key_moments(film: Film, target: str) -> list[KeyMoment]:
    """At most six: the start, when something was first taken for the target, changes of mind, the end."""
    return [_moment(film, i, title) for i, title in sorted(_chosen(film, target).items())]


def _chosen(film: Film, target: str) -> dict[int, str]:
    """Frame number -> title."""
    last = len(film.steps) - 1
    titles = {0: "start"}
    if first := next((b for b in film.beliefs if canonical(b.label) == canonical(target)), None):
        titles.setdefault(first.frame, f"something was taken for {with_article(target)} by {first.sources}")
    turns = [i for i in range(1, last) if _aim(film.plans[i]) not in (None, _aim(film.plans[i - 1]))]
    known = [i for i in turns if _kind(film.plans[i]) in ("target", "candidate", "stairs")]
    # What the robot went for in the end, then evenly from the others.
    wanted = [*known[-1:], *(turns[round(k * (len(turns) - 1) / 3)] for k in range(4) if turns)]
    for i in wanted:
        if len(titles) < _MOST - 1:
            titles.setdefault(i, _GOES_FOR.get(_kind(film.plans[i]), "goes on"))
    titles[last] = "end" if last else titles[0]
    return titles


def _kind(plan: Plan | None) -> str:
    return plan.waypoint.kind if plan is not None and plan.waypoint is not None else ""


def _aim(plan: Plan | None) -> tuple[object, ...] | None:
    """What a plan goes for; an object stays the same while its place is made out better."""
    w: Candidate | None = plan.waypoint if plan is not None else None
    if w is None:
        return None
    return (w.kind, w.object_id) if w.object_id is not None else (w.kind, round(w.x_m, 1), round(w.y_m, 1))


def _moment(film: Film, i: int, title: str) -> KeyMoment:
    step, plan, picture = film.steps[i], film.plans[i], film.pictures[i]
    why = ""
    if plan is not None:
        note = plan.waypoint.note if plan.waypoint is not None else ""
        why = "; ".join(dict.fromkeys(s for s in (plan.why, note) if s))
    grown = film.maps.get(step.floor)
    drawn = Markup(_map(film, i, grown)) if grown is not None else None
    return KeyMoment(i, f"Step {film.numbers[i]}: {title}", why, data_uri("webp", picture) if picture else "", drawn)


def _map(film: Film, i: int, grown: GrowingMap) -> str:
    """The map as it was known at frame ``i``, with the way there; in units of cells."""
    step, grid = film.steps[i], grown.grid
    states = grown.at(step.seq)
    rgba = np.zeros((*states.shape, 4), np.uint8)
    for state, layer in ((EXPLORED, "explored"), (OBSTACLE, "occupancy")):
        rgba[states == state] = (*(COLOURS[layer] or (0, 0, 0)), 255)
    image = tag("image", href=data_uri("png", encode_png(rgba)), width=grid.cols, height=grid.rows, class_="layer")

    def at(s: Step) -> str:
        """Where a step lies in the picture."""
        u = (s.x_m - grid.origin_x_m) / grid.resolution_m
        return f"{u:.1f},{grid.rows - (s.y_m - grid.origin_y_m) / grid.resolution_m:.1f}"

    way = " ".join(at(s) for s in film.steps[: i + 1] if s.floor == step.floor)
    px = max(grid.cols, grid.rows) / 100
    line = tag("polyline", points=way, fill="none", stroke=PATH, stroke_width=px)
    u, v = at(step).split(",")
    degrees = -float(np.degrees(step.yaw_rad))
    arrow = tag(
        "path",
        d="M3 0L-2 2L-1 0L-2 -2Z",
        fill=PATH,
        stroke="#fff",
        stroke_width=0.4,
        transform=f"translate({u} {v}) rotate({degrees:.0f}) scale({px:.2f})",
    )
    return drawing((grid.cols, grid.rows), [image, line, arrow], f"the map at step {film.numbers[i]}", "moment")
