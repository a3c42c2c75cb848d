"""What a search misses of an SPL of 1, split into parts that add up to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.runner.row import EpisodeRecord


class Loss(NamedTuple):
    """The parts of 1 - SPL, each 0 to 1. At most three of them aren't 0.

    A failure loses all of it, in one part: ``never_near`` if it never was within ``NEAR_M`` of a goal (``play.approach``), else
    ``failed_near``.

    A success with the shortest path l and the robot's path p has SPL = l / max(l, p). So it loses the metres that it drove too
    far, p - l, divided by p. They are split at the place a where the robot first was near a goal, after a path p_a with d_a left,
    and at the place c where it came near for the last time, after p_c with d_c left:

        before         e1 = p_a - (l - d_a)
        left_again     e2 = (p_c - p_a) - (d_a - d_c)
        last_approach  e3 = (p - p_c) - d_c            e1 + e2 + e3 = p - l

    Each is what the robot drove on that leg beyond what it came nearer to a goal. A path is never shorter than what it comes
    nearer, but for the grid of the shortest paths, and a robot may stop up to ``SUCCESS_M`` before a viewpoint: so an e can be a
    few centimetres below 0. It then counts as 0, and the others are made smaller in proportion:

        part i = (1 - SPL) max(0, ei) / (max(0, e1) + max(0, e2) + max(0, e3))

    This is ei / p if no e is below 0.
    """

    never_near: float = 0.0
    failed_near: float = 0.0
    before: float = 0.0
    left_again: float = 0.0
    last_approach: float = 0.0


#: By part: its name in tables, and how a sentence goes on after "so many points go".
NAMES: dict[str, tuple[str, str]] = {
    "never_near": ("never near", "on searches that fail without ever coming near a goal"),
    "failed_near": ("failed although near", "on searches that come near a goal and fail"),
    "before": ("way before", "on the way before the robot first comes near a goal"),
    "left_again": ("near and left again", "on coming near a goal and leaving again"),
    "last_approach": ("last approach", "on the last approach"),
}


def loss_of(record: EpisodeRecord) -> Loss:
    """The loss of a search. ValueError: its record doesn't say how near it came to a goal."""
    near, missing = record.approach, 1.0 - record.spl
    if near is None:
        raise ValueError(f"the search {record.key} doesn't say how near it came to a goal")
    if not record.success:
        return Loss(failed_near=missing) if near.came_near else Loss(never_near=missing)
    p_a, d_a, p_c, d_c = (
        near.first_near_path_m,
        near.first_near_left_m,
        near.last_near_path_m,
        near.last_near_left_m,
    )
    if p_a is None or d_a is None or p_c is None or d_c is None:
        raise ValueError(f"the search {record.key} succeeded, but its record says that it wasn't near a goal")
    before = max(0.0, p_a - (record.shortest_path_m - d_a))
    left_again = max(0.0, (p_c - p_a) - (d_a - d_c))
    last_approach = max(0.0, (record.path_m - p_c) - d_c)
    total = before + left_again + last_approach
    if total <= 0.0:  # only numbers that were rounded when they were kept come here
        return Loss(last_approach=missing)
    return Loss(0.0, 0.0, *(missing * part / total for part in (before, left_again, last_approach)))


def losses(records: Sequence[EpisodeRecord]) -> NDArray[np.float64]:
    """The losses of searches in points of SPL: (N, 5), a column for each field of ``Loss``."""
    return 100.0 * np.array([loss_of(r) for r in records], dtype=np.float64).reshape(-1, len(Loss._fields))
