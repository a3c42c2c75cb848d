"""One step of a mission: the paper's waypoint selection and navigation, on several floors.

    remember -> terrain -> scan? -> waypoint (target, else candidate, else another floor or frontier) -> drive, look, stop

Every way out is bounded: scans, looks, peeks, visits to a floor and tries at a stair are counted, a waypoint without
progress is given up, and whatever is given up twice (a confirmed target: four times) stays so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from services.planner.core import floors, memory, objects
from services.planner.core.choose import choose_frontier, choose_object, likeliest, settle, way_to
from services.planner.core.drive import FmmPlanner, LocalPlanner
from services.planner.core.now import FrontierRule, Now
from services.planner.core.pursue import approach, explore
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Decision, MapView, MissionState, RobotView
from services.planner.core.sweep import sweep
from services.planner.core.terrain import build_terrain, coarse_arrival_m

_FMM = FmmPlanner()
_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}
_MAX_TRIES = 64
_LIKELY = 0.5
_SHOWN = 12


def step(
    state: MissionState,
    maps: MapView,
    robot: RobotView,
    config: PlannerConfig,
    planner: LocalPlanner = _FMM,
    summaries: Mapping[str, Mapping[str, float]] = _NO_SUMMARIES,
    rule: FrontierRule = choose_frontier,
) -> tuple[MissionState, Decision]:
    """The next action of a mission on what the maps hold now.

    A stair that was refused needs no report: called again with the robot still on the old floor, the mission gets
    nearer to it or tries another.

    Args:
        state: what the mission remembers; not changed.
        maps: the joint maps of the robot's floor; they hold the robot's observation ``robot.seq``.
        robot: the robot at that observation.
        config: the core's settings.
        planner: drives to goal cells.
        summaries: by floor, label -> highest confidence that the cameras of that floor last reported.
        rule: chooses the frontier to explore.

    Returns:
        The new memory and the decision. ``found`` comes with ``stop``; a failure has no action and a name.
    """
    state = state.copy()
    floors.arrive(state, robot)
    memory.remember(state, robot, config)
    if state.step >= state.max_steps:
        return _finish(state, "out_of_steps", f"{state.max_steps} steps are used up without finding {state.target!r}")
    known_targets = objects.targets_of(maps.objects, state, config, weak=True)
    known_targets += objects.last_resorts(maps.objects, state, config)
    places = [(o.center_m[0], o.center_m[1]) for o in known_targets] + floors.stair_ends(state, robot, config)
    terrain = build_terrain(maps, robot, state, config, places)
    arrival = coarse_arrival_m(terrain, robot.x_m, robot.y_m)
    now = Now(state, maps, robot, config, planner, summaries, rule, terrain, arrival)

    if memory.is_stuck(state, config):
        memory.escape(state, config)
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


def _scan(now: Now) -> Decision | None:
    """The first look around on a floor, unless something near by is most likely the target, or nothing here may be it and
    it was seen elsewhere: a look around costs less than going by what stands behind the robot, or into a wall that no
    camera sees."""
    here, turns = now.state.here, now.config.scan_turns
    if here.scan_left == 0:
        return None
    known = objects.targets_of(now.maps.objects, now.state, now.config)
    likely = [o for o in known if objects.chance(o, now.state.target, now.config) >= _LIKELY]
    if any(way_to(now, o) <= now.config.scan_unless_m for o in likely):
        here.scan_left = 0
        return None
    if here.scan_left is None:
        if known and now.state.errand is not None:
            return None  # on the way elsewhere: what is worth more is weighed
        if not known and (decision := floors.travel(now)):
            return decision
        here.scan_left = turns
        here.scans.append((now.robot.x_m, now.robot.y_m))
    here.scan_left -= 1
    memory.rest(now.state)
    return now.decide("turn_left", "scanning", f"looking around, {turns - here.scan_left} of {turns}")


def _pursue(now: Now) -> Decision:
    """Waypoints in the paper's order until one gives an action: confirmed target, promising candidate, then the floor
    whose cameras saw the target or the best frontier.

    When none is left, what was only put off gets its second chance, then any weak candidate, then the other floors,
    then a second look around, then frontiers that are hard to get to, then the likeliest object of all, dropped and
    rejected ones, too (also when the steps run out); then the mission ends.
    """
    state, weak, hard = now.state, False, False
    if _runs_out_of_steps(now):
        settle(now)
    for _ in range(_MAX_TRIES):
        now.weighed.clear()
        if record := choose_object(now, weak=weak):
            decision = approach(now, record)
        elif decision := floors.travel(now):
            return decision
        elif (hard or not weak) and (frontier := now.rule(now, hard=hard)):
            decision = explore(now, frontier)
        elif memory.revive(state):
            continue
        elif not weak:
            weak = True
            continue
        elif floors.leave(now):
            weak = hard = False
            continue
        elif decision := sweep(now):
            return decision
        elif not hard:
            hard = True
            continue
        elif floors.go_back(now) or settle(now):
            continue
        else:
            break
        if decision is not None:
            return decision
    return _give_up(now)


def _runs_out_of_steps(now: Now) -> bool:
    """Whether the steps left just about take the robot to the likeliest object of all."""
    state, config = now.state, now.config
    if (best := likeliest(now)) is None:
        return False
    needed = config.steps_per_m * way_to(now, best) + config.patience_steps
    return state.max_steps - state.step <= needed


def _give_up(now: Now) -> Decision:
    """Nothing is left to do: why."""
    state, stairs = now.state, floors.what_was_barred(now)
    if state.escapes:  # it gave everything up because it can't move
        return _failure("stuck", f"the robot didn't move on from ({now.robot.x_m:.1f}, {now.robot.y_m:.1f})")
    if state.unreachable:
        return _failure("unreachable", state.unreachable)
    if stairs and floors.seen_elsewhere(now):
        return _failure(
            "unreachable", f"{state.target!r} was seen on floor {floors.seen_elsewhere(now)!r}, but {stairs}"
        )
    message = f"nothing is left to explore or to look at, and {state.target!r} was not found"
    return _failure("not_found", f"{message}; {stairs}" if stairs else message)
