"""Which waypoint comes next: an object to go to, or the frontier worth most."""

from __future__ import annotations

import math
from typing import Literal

from services.planner.core import memory, objects
from services.planner.core.frontiers import Frontier, find_frontiers, rank
from services.planner.core.now import Now
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import MissionState
from surveilnav.messages import Candidate, ObjectRecord


def choose_object(now: Now, *, weak: bool) -> ObjectRecord | None:
    """The object to go to: confirmed before promising, then relevance less a price per metre; the present one
    is kept unless another is clearly better."""
    state, config, robot = now.state, now.config, now.robot
    awake = [
        o for o in objects.targets_of(now.maps.objects, state, config, weak=weak)
        if not memory.is_dormant(state, o.center_m[0], o.center_m[1], config)
    ]  # fmt: skip
    if not awake:
        return None

    def score(o: ObjectRecord) -> float:
        away_m = math.hypot(o.center_m[0] - robot.x_m, o.center_m[1] - robot.y_m)
        return objects.relevance(o, state.target) - config.distance_weight_per_m * away_m

    confirmed = [o for o in awake if objects.is_confirmed(o, state.target)]
    pool = confirmed or awake
    best = max(pool, key=score)
    held = next((o for o in pool if _is_committed(state, o, config)), None)
    chosen = held if held is not None and score(best) <= score(held) + config.switch_margin_value else best
    for o in awake:
        kind: Literal["target", "candidate"] = "target" if objects.is_confirmed(o, state.target) else "candidate"
        now.weighed.append(Candidate(kind, o.center_m[0], o.center_m[1], score(o), o is chosen, o.reason[:120], o.id))
    now.commit(now.weighed[awake.index(chosen)], last_resort=weak)
    return chosen


def choose_frontier(now: Now) -> Frontier | None:
    """The best frontier by the strategy; the present one is kept unless another is clearly better."""
    state, config = now.state, now.config
    found = find_frontiers(now.maps, now.terrain, now.arrival, config)
    awake = [f for f in found if not memory.is_dormant(state, f.x_m, f.y_m, config)]
    if not awake:
        return None
    ranked, by_value = rank(awake, now.maps, state.target, config)
    chosen, margin = ranked[0], config.switch_margin_value if by_value else config.switch_margin_m
    if state.commitment is not None and state.commitment.kind == "frontier":
        place = state.commitment.x_m, state.commitment.y_m
        held = min(ranked, key=lambda f: math.dist((f.x_m, f.y_m), place))
        near = math.dist((held.x_m, held.y_m), place) <= 1.5 * config.same_place_m
        if near and chosen.score <= held.score + margin:
            chosen = held
    why = "by value" if by_value else "nearest"
    for f in ranked:
        now.weighed.append(Candidate("frontier", f.x_m, f.y_m, f.score, f is chosen, f"{why}, {f.way_m:.1f} m"))
    now.commit(next(c for c in now.weighed if c.chosen))
    return chosen


def _is_committed(state: MissionState, record: ObjectRecord, config: PlannerConfig) -> bool:
    """The object that the robot is on its way to, also after fusion merged it into another at the same place."""
    held = state.commitment
    if held is None or held.object_id is None:
        return False
    near = math.hypot(record.center_m[0] - held.x_m, record.center_m[1] - held.y_m) < config.same_place_m
    return held.object_id == record.id or near
