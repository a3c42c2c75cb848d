"""Which waypoint comes next: an object to go to, or the frontier worth most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from services.planner.core import memory, objects
from services.planner.core.frontiers import Frontier, rank
from services.planner.core.now import Now
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import MissionState
from surveilnav.messages import Candidate, ObjectRecord


def choose_object(now: Now, *, weak: bool) -> ObjectRecord | None:
    """The object to go to: the one most worth its way (``objects.chance`` per metre), if it is worth more than exploring;
    the present one is kept unless another is clearly better. ``weak``: also those that hardly anything speaks for, or
    that are hard to get to, even if exploring is worth more."""
    state, config = now.state, now.config
    known = objects.targets_of(now.maps.objects, state, config, weak=weak)
    ways_m = {o.id: way_to(now, o) for o in known}
    awake = [o for o in known if not _sleeps(now, o)]
    if not weak:
        awake = [o for o in awake if objects.is_confirmed(o, state.target) or not _is_doubtful(now, o, ways_m[o.id])]
    held = state.commitment
    on_the_way = held is not None and held.object_id is not None and not held.last_resort
    if on_the_way and not any(_is_committed(state, o, config) for o in awake):
        _note_wavering(state)
    if not awake:
        return None

    worth = {o.id: _worth(now, o, ways_m[o.id]) for o in awake}
    best = max(awake, key=lambda o: worth[o.id])
    kept = next((o for o in awake if _is_committed(state, o, config)), None)
    chosen = kept if kept is not None and worth[best.id] <= config.switch_ratio * worth[kept.id] else best
    sure = objects.is_confirmed(chosen, state.target)
    if not weak and not sure and worth[chosen.id] <= config.switch_ratio * _errand_worth(now):
        return None
    if not weak and exploring_is_worth(now, more_than=worth[chosen.id] * (config.switch_ratio if kept else 1.0)):
        if kept:
            _note_wavering(state)
        return None
    for o in awake:
        kind: Literal["target", "candidate"] = "target" if objects.is_confirmed(o, state.target) else "candidate"
        now.weighed.append(
            Candidate(kind, o.center_m[0], o.center_m[1], worth[o.id], o is chosen, o.reason[:120], o.id)
        )
    now.commit(now.weighed[awake.index(chosen)], last_resort=weak)
    return chosen


def settle(now: Now) -> bool:
    """Takes the likeliest object of all for the target after all; whether that is news."""
    state, best = now.state, likeliest(now)
    if best is not None and best.id == state.here.settled_for:
        return False
    state.here.settled_for = best.id if best else None
    if best is None:
        return False
    memory.wake(state, *best.center_m[:2], now.config)
    return True


def likeliest(now: Now) -> ObjectRecord | None:
    """The last resort that the robot settled for before, while it is one, else the likeliest that a way leads to."""
    may_be = objects.last_resorts(now.maps.objects, now.state, now.config)
    held = next((o for o in may_be if o.id == now.state.here.settled_for), None)
    return held or next((o for o in may_be if _is_reachable(now, o)), None)


def choose_frontier(now: Now, *, hard: bool) -> Frontier | None:
    """Our ``FrontierRule``: the best frontier by the strategy; the present one is kept unless another is clearly
    better."""
    state, config = now.state, now.config
    awake = open_frontiers(now, hard=hard)
    if not awake:
        return None
    ranked, by_value = rank(awake, now.maps, state.target, config)
    chosen, held = ranked[0], held_frontier(now, ranked, 1.5 * config.same_place_m)
    if held is not None and chosen.score <= held.score * config.switch_ratio:
        chosen = held
    return head_for(now, ranked, chosen, "by value" if by_value else "nearest")


def open_frontiers(now: Now, *, hard: bool) -> list[Frontier]:
    """The frontiers that a rule may choose from: not given up and, unless ``hard``, not hard to get to."""
    state, config = now.state, now.config
    return [
        f for f in now.frontiers()
        if not memory.is_dormant(state, f.x_m, f.y_m, config) and (hard or not _is_put_off(now, f))
    ]  # fmt: skip


def held_frontier(now: Now, frontiers: Sequence[Frontier], within_m: float) -> Frontier | None:
    """The one nearest to the frontier that the robot is on its way to, if one is so near to it."""
    held = now.state.commitment
    if held is None or held.kind != "frontier":
        return None
    place = held.x_m, held.y_m
    nearest = min(frontiers, key=lambda f: math.dist((f.x_m, f.y_m), place))
    return nearest if math.dist((nearest.x_m, nearest.y_m), place) <= within_m else None


def head_for(now: Now, frontiers: Sequence[Frontier], chosen: Frontier, why: str) -> Frontier:
    """Notes what was weighed and commits to the chosen one."""
    for f in frontiers:
        now.weighed.append(Candidate("frontier", f.x_m, f.y_m, f.score, f is chosen, f"{why}, {f.way_m:.1f} m"))
    now.commit(next(c for c in now.weighed if c.chosen))
    return chosen


def exploring_is_worth(now: Now, *, more_than: float) -> bool:
    """Whether some frontier promises more per metre than this."""
    config = now.config
    chance = config.explore_chances.get(now.state.target, config.explore_chance)
    if config.objects_first or chance * (1.0 + config.value_gain) <= more_than * config.explore_m:
        return False
    if not (awake := open_frontiers(now, hard=False)):
        return False
    ranked, _ = rank(awake, now.maps, now.state.target, config)
    return chance * ranked[0].score > more_than


def _worth(now: Now, record: ObjectRecord, way_m: float) -> float:
    """The chance per metre of an object; what the robot settles for comes before all else."""
    if record.id == now.state.here.settled_for:
        return 1.0
    return objects.chance(record, now.state.target, now.config) / (way_m + now.config.verify_m)


def _is_committed(state: MissionState, record: ObjectRecord, config: PlannerConfig) -> bool:
    """The object that the robot is on its way to, also after fusion merged it into another at the same place."""
    held = state.commitment
    if held is None or held.object_id is None:
        return False
    near = math.hypot(record.center_m[0] - held.x_m, record.center_m[1] - held.y_m) < config.same_place_m
    return held.object_id == record.id or near


def _note_wavering(state: MissionState) -> None:
    """The object that the robot was on its way to ceased to be promising."""
    assert state.commitment is not None
    assert state.commitment.object_id is not None
    wavered, object_id = state.here.wavered, state.commitment.object_id
    wavered[object_id] = wavered.get(object_id, 0) + 1
    state.commitment = None


def _errand_worth(now: Now) -> float:
    """What the way to the stairs of the present errand was worth when the robot set out: to be beaten clearly, as the
    waypoint held always is."""
    state = now.state
    on_the_way = state.commitment is not None and state.commitment.kind == "stairs"
    return state.errand.worth if on_the_way and state.errand is not None else 0.0


def _sleeps(now: Now, record: ObjectRecord) -> bool:
    tries = memory.FOR_GOOD_CONFIRMED if objects.is_confirmed(record, now.state.target) else memory.FOR_GOOD
    return memory.is_dormant(now.state, record.center_m[0], record.center_m[1], now.config, tries)


def _is_doubtful(now: Now, record: ObjectRecord, way_m: float) -> bool:
    """Whether an unconfirmed object had better wait: it stopped being promising more than once with the robot on its way
    there (views that disagree must not turn it to and fro), or is hard to get to. What was settled for isn't."""
    if record.id == now.state.here.settled_for:
        return False
    if now.state.here.wavered.get(record.id, 0) > 1:
        return True
    x_m, y_m, _ = record.center_m
    return _is_hard(now, x_m, y_m, way_m)


def _is_put_off(now: Now, frontier: Frontier) -> bool:
    """Whether a frontier is hard to get to. Once put off, it stays so."""
    put_off, place = now.state.here.put_off, (frontier.x_m, frontier.y_m)
    if any(math.dist(other, place) < now.config.same_place_m for other in put_off):
        return True
    if hard := _is_hard(now, *place, frontier.way_m):
        put_off.append(place)
    return hard


def _is_hard(now: Now, x_m: float, y_m: float, way_m: float) -> bool:
    """Whether a place is much farther than its distance explains, because the way leads through gaps that a robot most
    likely can't pass: what is seen through a window looks like that."""
    straight_m = math.hypot(x_m - now.robot.x_m, y_m - now.robot.y_m)
    if way_m <= now.config.hard_way_m + 2.0 * straight_m:
        return False
    wide_m = now.terrain.least_near(now.wide_arrival(), x_m, y_m, now.config.same_place_m)
    return wide_m > way_m + 1.0


def way_to(now: Now, record: ObjectRecord) -> float:
    """Travel time [m] to about where one would stand before an object; twice the distance where no way is known."""
    x_m, y_m, _ = record.center_m
    way_m = _known_way_to(now, record)
    return 2.0 * math.hypot(x_m - now.robot.x_m, y_m - now.robot.y_m) if math.isinf(way_m) else way_m


def _is_reachable(now: Now, record: ObjectRecord) -> bool:
    """Whether a way leads to about where one would stand before an object."""
    return math.isfinite(_known_way_to(now, record))


def _known_way_to(now: Now, record: ObjectRecord) -> float:
    reach_m = 1.0 + 0.5 * min(record.size_m[:2])
    return now.terrain.least_near(now.arrival, *record.center_m[:2], reach_m)
