"""One step of a mission: the paper's waypoint selection and navigation.

    remember -> terrain -> scan? -> waypoint (target, else candidate, else frontier) -> drive, look, or stop

Every way out is bounded: scans, looks and peeks are counted, a waypoint without progress is given up, and
whatever is given up twice stays so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from services.planner.core import memory, objects
from services.planner.core.drive import FmmPlanner, LocalPlanner, Route, bearing_error_rad, turn_towards
from services.planner.core.frontiers import Frontier, find_frontiers, rank, unknown_side
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Commitment, Decision, MapView, MissionState, RobotView
from services.planner.core.terrain import Terrain, build_terrain, coarse_arrival_m
from surveilnav.messages import Candidate, ObjectRecord

_FMM = FmmPlanner()
_MAX_TRIES = 64
_SHOWN = 12


@dataclass(slots=True, eq=False)
class _Now:
    """Everything about this step; ``state`` is the copy that this step may change."""

    state: MissionState
    maps: MapView
    robot: RobotView
    config: PlannerConfig
    planner: LocalPlanner
    terrain: Terrain
    arrival: NDArray[np.float64]
    weighed: list[Candidate] = field(default_factory=list)


def step(
    state: MissionState, maps: MapView, robot: RobotView, config: PlannerConfig, planner: LocalPlanner = _FMM
) -> tuple[MissionState, Decision]:
    """The next action of a mission on what the maps hold now.

    Args:
        state: what the mission remembers; not changed.
        maps: the joint maps of the robot's floor; they hold the robot's observation ``robot.seq``.
        robot: the robot at that observation.
        config: the core's settings.
        planner: drives to goal cells.

    Returns:
        The new memory and the decision. ``found`` comes with ``stop``; a failure has no action and a name.
    """
    state = state.copy()
    memory.remember(state, robot, config)
    if state.step >= state.max_steps:
        return _finish(state, "out_of_steps", f"{state.max_steps} steps are used up without finding {state.target!r}")
    known_targets = objects.targets_of(maps.objects, state, config, weak=True)
    terrain = build_terrain(maps, robot, state, config, [(o.center_m[0], o.center_m[1]) for o in known_targets])
    arrival = coarse_arrival_m(terrain, robot.x_m, robot.y_m)
    now = _Now(state, maps, robot, config, planner, terrain, arrival)

    if memory.is_stuck(state, config):
        _escape(now)
        if state.escapes > config.max_escapes:
            place = f"({robot.x_m:.1f}, {robot.y_m:.1f})"
            return _finish(state, "stuck", f"the robot didn't move on from {place} in {state.escapes} tries")
    decision = _scan(now) or _pursue(now)
    if decision.finished:
        state.finished = True
    if decision.action is not None:
        state.step += 1
    return state, replace(decision, candidates=tuple(now.weighed[:_SHOWN]))


def _finish(state: MissionState, error: str, message: str) -> tuple[MissionState, Decision]:
    state.finished = True
    return state, _failure(error, message)


def _failure(error: str, message: str) -> Decision:
    return Decision(None, "finished", message, finished=True, error=error)


def _escape(now: _Now) -> None:
    """Gives up the present waypoint and forgets the collisions: they may be what shuts the robot in."""
    state = now.state
    state.escapes += 1
    if state.commitment is not None:
        memory.give_up(state, state.commitment.x_m, state.commitment.y_m, now.config)
    state.collisions.clear()
    state.bumps.clear()
    memory.rest(state)


def _scan(now: _Now) -> Decision | None:
    """The first look around, unless something worth going to is known already."""
    state = now.state
    if state.scan_left is None:
        state.scan_left = now.config.scan_turns
    if state.scan_left == 0 or objects.targets_of(now.maps.objects, state, now.config):
        state.scan_left = 0
        return None
    if state.scan_left == now.config.scan_turns:
        state.scans.append((now.robot.x_m, now.robot.y_m))
    done = now.config.scan_turns - state.scan_left
    state.scan_left -= 1
    memory.rest(state)
    return Decision("turn_left", "scanning", f"looking around, {done + 1} of {now.config.scan_turns}")


def _pursue(now: _Now) -> Decision:
    """Waypoints in the paper's order until one gives an action: confirmed target, promising candidate, best frontier.

    When none is left, what was only put off gets its second chance, then any weak candidate; then the mission ends.
    """
    state, weak = now.state, False
    for _ in range(_MAX_TRIES):
        now.weighed.clear()
        chosen = _choose_object(now, weak=weak) or (None if weak else _choose_frontier(now))
        if isinstance(chosen, ObjectRecord):
            decision = _approach(now, chosen)
        elif chosen is not None:
            decision = _explore(now, chosen)
        elif memory.revive(state):
            continue
        elif not weak:
            weak = True
            continue
        elif decision := _sweep(now):
            return decision
        elif state.settled_for is None and (best := objects.reconsider(now.maps.objects, state, now.config)):
            del state.dropped[best.id]
            state.looks.pop(best.id, None)
            state.settled_for = best.id
            continue
        else:
            break
        if decision is not None:
            return decision
    if state.escapes:  # it gave everything up because it can't move
        return _failure("stuck", f"the robot didn't move on from ({now.robot.x_m:.1f}, {now.robot.y_m:.1f})")
    if state.unreachable:
        return _failure("unreachable", state.unreachable)
    return _failure("not_found", f"nothing is left to explore or to look at, and {state.target!r} was not found")


def _sweep(now: _Now) -> Decision | None:
    """All is explored and the target wasn't seen: looks all around once more from places far from earlier such looks,
    the most promising and nearest first. None when no such place is left."""
    state, config, robot, terrain = now.state, now.config, now.robot, now.terrain
    if config.sweep_m <= 0:
        return None
    if state.sweep_left and math.dist((robot.x_m, robot.y_m), state.scans[-1]) < config.reached_m:
        state.sweep_left -= 1
        memory.rest(state)
        return _decision(now, "turn_left", "sweeping", f"looking around once more, {state.sweep_left} turns to go")
    state.sweep_left = 0
    for _ in range(_MAX_TRIES):
        place = _sweep_place(now)
        if place is None:
            return None
        if math.dist(place, (robot.x_m, robot.y_m)) <= config.reached_m:
            state.scans.append((robot.x_m, robot.y_m))
            state.sweep_left = config.scan_turns - 1
            return _decision(now, "turn_left", "sweeping", "looking around once more")
        _commit(now, Candidate("sweep", *place, 0.0, True, "far from every look around"))
        route = _drive(now, terrain.disc(*place, 0.2) & np.isfinite(now.arrival))
        if route is not None:
            message = f"to look around once more, {route.remaining_m:.1f} m"
            return _level(now) or _decision(now, route.action, "sweeping", message, route)
        state.scans.append(place)  # it can't be got to: as good as looked at
    return None


def _sweep_place(now: _Now) -> tuple[float, float] | None:
    """Where to look around next; the present choice is kept while it stands."""
    state, config, terrain, held = now.state, now.config, now.terrain, now.state.commitment
    unseen = np.ones(terrain.grid.shape, dtype=np.uint8)
    for x_m, y_m in state.scans:
        unseen[terrain.disc(x_m, y_m, config.sweep_m)] = 0
    places = (unseen != 0) & terrain.known & np.isfinite(now.arrival) & (terrain.speed > config.tight_speed)
    if held is not None and held.kind == "sweep" and places[terrain.cell(held.x_m, held.y_m)]:
        return held.x_m, held.y_m
    if not places.any():
        return None
    value = np.nan_to_num(terrain.crop(now.maps.value), nan=0.0)
    window = 2 * round(1.0 / terrain.grid.resolution_m) + 1
    score = cv2.blur(value.astype(np.float32), (window, window)) - config.distance_weight_per_m * now.arrival
    row, col = np.unravel_index(int(np.argmax(np.where(places, score, -np.inf))), score.shape)
    return terrain.place(int(row), int(col))


# --- choosing ---------------------------------------------------------------------------------------------------------


def _choose_object(now: _Now, *, weak: bool) -> ObjectRecord | None:
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
    _commit(now, now.weighed[awake.index(chosen)], last_resort=weak)
    return chosen


def _choose_frontier(now: _Now) -> Frontier | None:
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
    _commit(now, next(c for c in now.weighed if c.chosen))
    return chosen


def _is_committed(state: MissionState, record: ObjectRecord, config: PlannerConfig) -> bool:
    """The object that the robot is on its way to, also after fusion merged it into another at the same place."""
    held = state.commitment
    if held is None or held.object_id is None:
        return False
    near = math.hypot(record.center_m[0] - held.x_m, record.center_m[1] - held.y_m) < config.same_place_m
    return held.object_id == record.id or near


def _commit(now: _Now, chosen: Candidate, *, last_resort: bool = False) -> None:
    """Notes the waypoint; patience starts anew only for another place."""
    state, held = now.state, now.state.commitment
    same = held is not None and (held.object_id is None) == (chosen.object_id is None) and (
        held.object_id == chosen.object_id
        if chosen.object_id is not None
        else math.hypot(held.x_m - chosen.x_m, held.y_m - chosen.y_m) <= 1.5 * now.config.same_place_m
    )  # fmt: skip
    kind = "frontier" if chosen.kind == "stairs" else chosen.kind
    if held is not None and same:
        state.commitment = replace(held, kind=kind, x_m=chosen.x_m, y_m=chosen.y_m)
    else:
        state.peeks = 0
        state.commitment = Commitment(
            kind, chosen.x_m, chosen.y_m, state.step, math.inf, state.step, chosen.object_id, last_resort
        )


# --- pursuing ---------------------------------------------------------------------------------------------------------


def _explore(now: _Now, frontier: Frontier) -> Decision | None:
    """Drives to a frontier; there turns to what it hides once, and leaves it for good if it is still one."""
    state, config, robot = now.state, now.config, now.robot
    if levelled := _level(now):
        return levelled
    away_m = math.hypot(frontier.x_m - robot.x_m, frontier.y_m - robot.y_m)
    if away_m <= config.reached_m:
        side = unknown_side(now.maps, now.terrain, frontier.x_m, frontier.y_m)
        turn = turn_towards(robot, *side, config) if side else None
        if turn is None or state.peeks >= config.scan_turns // 2:
            memory.give_up(state, frontier.x_m, frontier.y_m, config, for_good=True)
            return None
        state.peeks += 1
        return _decision(now, turn, "exploring", "looking past a frontier")
    goals = now.terrain.disc(frontier.x_m, frontier.y_m, config.reached_m * 0.6) & np.isfinite(now.arrival)
    if not goals.any():
        goals = now.terrain.disc(frontier.x_m, frontier.y_m, config.same_place_m) & np.isfinite(now.arrival)
    route = _drive(now, goals)
    if route is None:
        return None
    return _decision(now, route.action, "exploring", f"to a frontier, {route.remaining_m:.1f} m", route)


def _approach(now: _Now, record: ObjectRecord) -> Decision | None:
    """Goes near an object, looks at it on the way, and stops if it is the target: two-level verification."""
    state, config, robot = now.state, now.config, now.robot
    judged = objects.verdict(record, state.target, config)
    if judged == "open" and record.id == state.settled_for:
        judged = "verified"
    if judged == "contradicted":
        _drop(state, record, f"the robot sees {record.label_robot or 'something else'}")
        return None
    place = objects.standoff(now.terrain, now.arrival, record, robot, config)
    if place is None:
        if objects.is_confirmed(record, state.target):
            x, y, _ = record.center_m
            state.unreachable = f"{state.target!r} was seen at ({x:.1f}, {y:.1f}), but no way leads near it"
        memory.give_up(state, record.center_m[0], record.center_m[1], config)
        return None
    here = now.terrain.cell(robot.x_m, robot.y_m)
    away_m = float(place.distance_m[here])
    arrived = bool(place.goals[here]) or (away_m <= max(config.stop_m, place.nearest_m) and bool(place.sight[here]))
    if arrived:
        return _confirm(now, record, judged)

    if levelled := _level(now):
        return levelled
    off_rad = bearing_error_rad(robot, record.center_m[0], record.center_m[1])
    unsure = judged != "verified" and away_m <= config.inspect_m and bool(place.sight[here])
    if unsure and abs(off_rad) > config.half_fov_rad and state.inspected.get(record.id, 0) < config.scan_turns // 2:
        state.inspected[record.id] = state.inspected.get(record.id, 0) + 1
        return _decision(now, "turn_left" if off_rad > 0 else "turn_right", "confirming", f"turning to {_what(record)}")
    route = _drive(now, place.goals)
    if route is None:
        return None
    return _decision(now, route.action, "approaching", f"to {_what(record)}, {route.remaining_m:.1f} m", route)


def _confirm(now: _Now, record: ObjectRecord, judged: objects.Verdict) -> Decision | None:
    """At the object: faces it; stops if verified, else looks from a few more directions and then decides."""
    state, config, robot = now.state, now.config, now.robot
    memory.rest(state)
    spent = state.looks.get(record.id, 0)
    turn = turn_towards(robot, record.center_m[0], record.center_m[1], config)
    commitment = state.commitment
    waited = state.step - commitment.best_step if commitment is not None else 0
    if judged == "verified":
        if turn and waited < config.patience_steps:
            return _decision(now, turn, "confirming", f"turning to {_what(record)}")
        weakly = record.id == state.settled_for and not objects.is_confirmed(record, state.target)
        why = "weak evidence, but nothing else is left to look at" if weakly else "seen by the robot itself"
        return _found(now, record, why)
    if spent == 0 and turn and waited < config.patience_steps:
        return _decision(now, turn, "confirming", f"turning to {_what(record)}")
    away_m = math.hypot(record.center_m[0] - robot.x_m, record.center_m[1] - robot.y_m)
    drop_m = now.maps.floor_z_m + config.camera_height_m - record.center_m[2]
    low = math.atan2(drop_m, max(away_m, 0.1)) > config.turn_rad / 2
    looks = ("look_down" if low else "turn_right", "turn_left", "turn_right", "turn_right")[: config.max_looks]
    if spent < len(looks) and config.verification != "paper":
        state.looks[record.id] = spent + 1
        message = f"looking at {_what(record)} again, {spent + 1} of {len(looks)}"
        return _decision(now, looks[spent], "confirming", message)
    if objects.good_enough(record, state.target, config):
        return _found(now, record, "strong surveillance evidence, which the robot's views don't contradict")
    _drop(state, record, "the robot's own views didn't confirm it")
    return None


def _found(now: _Now, record: ObjectRecord, why: str) -> Decision:
    decision = _decision(now, "stop", "finished", f"found {_what(record)}: {why}")
    return replace(decision, finished=True, found=True)


def _drop(state: MissionState, record: ObjectRecord, why: str) -> None:
    state.dropped[record.id] = (record.center_m[0], record.center_m[1], why)
    state.commitment = None


def _drive(now: _Now, goals: NDArray[np.bool_]) -> Route | None:
    """The way to the goals; None, and the waypoint is given up, if there is none or nothing was gained for long."""
    state, held = now.state, now.state.commitment
    assert held is not None
    expected_m = float(now.arrival[goals].min(initial=math.inf))
    route = now.planner.route(now.terrain, goals, now.robot, now.config, expected_m)
    if route is not None and route.remaining_m < held.best_m - 0.1:
        state.commitment = replace(held, best_m=route.remaining_m, best_step=state.step)
    elif route is None or state.step - held.best_step > now.config.patience_steps:
        if held.kind == "target":
            place = f"({held.x_m:.1f}, {held.y_m:.1f})"
            state.unreachable = f"{state.target!r} was seen at {place}, but the robot can't get near it"
        memory.give_up(state, held.x_m, held.y_m, now.config)
        return None
    return route


def _level(now: _Now) -> Decision | None:
    """Brings the camera back to the horizon after a look."""
    if abs(now.robot.pitch_rad) <= now.config.turn_rad / 2:
        return None
    return _decision(now, "look_up" if now.robot.pitch_rad < 0 else "look_down", "exploring", "levelling the camera")


def _decision(now: _Now, action: str, phase: str, message: str, route: Route | None = None) -> Decision:
    chosen = next((c for c in now.weighed if c.chosen), None)
    here = now.robot.x_m, now.robot.y_m
    path = (here, *route.path[1:]) if route else (here,)
    length_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if route else None
    object_id = chosen.object_id if chosen else None
    return Decision(action, phase, message, plan=chosen, path=path, distance_m=length_m, object_id=object_id)


def _what(record: ObjectRecord) -> str:
    return f"{record.label} {record.id} (confidence {record.confidence:.2f})"
