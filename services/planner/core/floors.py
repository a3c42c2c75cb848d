"""Several floors: which one to search next, and the way there over the stairs.

The cameras of every floor report what they last saw (``summaries``, a few hundred bytes a camera). A robot with nothing
to go for on its own floor goes where they saw the target; one that has searched its floor goes on to the next, unless it
was told that the target is here (``floor_chance`` 1). It never swings between floors: one is left unsearched only for a
floor not visited before whose cameras' evidence is better by a margin, if exploring on here isn't worth more; a searched
floor isn't searched again, and visits are counted.
"""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from services.planner.core import memory, objects
from services.planner.core.choose import exploring_is_worth
from services.planner.core.now import Now
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import Decision, Errand, FloorChange, FloorMemory, MissionState, RobotView
from services.planner.core.terrain import clear_lines
from surveilnav.messages import Candidate, Stair

#: A stair's end counts as seen if a cell so near to it is explored.
_SEEN_M = 0.3
_NEW = FloorMemory()


def arrive(state: MissionState, robot: RobotView) -> None:
    """Notes the robot's floor: what belongs to the way on the old one is forgotten, the old floor's memory kept.

    A stair that was to be taken while the robot is still on the same floor was refused.
    """
    taking, state.taking = state.taking, None
    if state.floor == robot.floor:
        if taking is not None:
            memory.fail_stair(state, *taking[:2])
            state.step -= taking[2] - 1
        return
    if state.floor:
        why = state.errand.why if taking and state.errand else "it was taken there"
        state.changes.append(FloorChange(state.step, state.floor, robot.floor, why))
    state.floor = robot.floor
    state.here.visits += 1
    state.commitment, state.anchor, state.escapes, state.peeks, state.sweep_left = None, None, 0, 0, 0
    if state.errand and state.errand.to_floor == robot.floor:
        state.errand = None


def stair_ends(state: MissionState, robot: RobotView, config: PlannerConfig) -> list[tuple[float, float]]:
    """(x, y) [m] of the stairs of this floor that may be headed for unseen."""
    if config.stairs_known == "seen" and not state.here.exhausted:
        return []
    return [stair.at_m[:2] for stair in robot.stairs if stair.floor == robot.floor]


def travel(now: Now) -> Decision | None:
    """On to the floor of the present errand, or of one that this floor's lack of evidence calls for; None: stay."""
    state = now.state
    if _surely_here(now):
        state.errand = None
        return None
    if state.errand is None or not _stands(now, state.errand):
        state.errand = _tempting(now)
    while state.errand is not None:
        stair = _ways(now).get(state.errand.to_floor, (0.0, None))[1]
        if stair is None:  # barred since: explore on, or to another floor where the cameras saw the target
            if not state.here.exhausted:
                state.errand = None
            return None
        if decision := _to_stair(now, stair):
            return decision
    return None


def leave(now: Now) -> bool:
    """This floor is searched: sends the robot to the one whose cameras saw the target most surely, if they did, else to
    the nearest that isn't searched. False: there is none to be got to."""
    if _surely_here(now):
        return False
    state = now.state
    best = next(iter(objects.last_resorts(now.maps.objects, state, now.config)), None)
    state.here.exhausted = True
    state.here.reserve = objects.chance(best, state.target, now.config) if best else 0.0
    ways = _ways(now)
    left = [floor for floor in sorted(ways) if not _memory(now, floor).exhausted and _may_visit(now, floor)]
    # what is less than sure is no reason to pass by a floor that nobody has looked at
    saw = {floor: e if (e := _evidence(now, floor)) >= now.config.floor_confidence else 0.0 for floor in left}
    chosen = min(left, key=lambda floor: (-saw[floor], ways[floor][0]), default=None)
    if chosen is None:
        state.errand = None
        return False
    sure = f"the cameras of floor {chosen} saw {state.target!r} with {saw[chosen]:.2f}"
    why = sure if saw[chosen] else f"floor {chosen} is the nearest that isn't"
    state.errand = Errand(chosen, f"floor {state.floor} is searched; {why}")
    return True


def go_back(now: Now) -> bool:
    """All floors are searched: sends the robot back to the one with the likeliest object of all, if that isn't this."""
    state, ways = now.state, _ways(now)
    left = [f for f in sorted(ways) if _memory(now, f).settled_for is None and _may_visit(now, f)]
    best = max(left, key=lambda floor: (_memory(now, floor).reserve, -ways[floor][0]), default=None)
    here = state.here.reserve if state.here.settled_for is None else 0.0
    if best is None or _memory(now, best).reserve <= here:
        return False
    state.errand = Errand(best, f"all is searched, and the best seen was on floor {best}")
    return True


def seen_elsewhere(now: Now) -> str:
    """The floor, not searched, whose cameras saw the target surely enough; "" if none did."""
    found = {floor: _evidence(now, floor) for floor in sorted(now.summaries) if floor != now.state.floor}
    best = max(found, key=lambda floor: found[floor], default="")
    return best if best and found[best] >= now.config.floor_confidence else ""


def what_was_barred(now: Now) -> str:
    """Which stairs of this floor to floors not searched the robot couldn't take, for people; "" if none."""
    if _surely_here(now):
        return ""
    barred = [
        f"{memory.stair_name(*s.at_m[:2])} to floor {s.to_floor}" for s in now.robot.stairs
        if s.floor == now.state.floor and not _memory(now, s.to_floor).exhausted
    ]  # fmt: skip
    return f"the stairs at {', '.join(sorted(barred))} couldn't be reached or taken" if barred else ""


def _memory(now: Now, floor: str) -> FloorMemory:
    return now.state.floors.get(floor, _NEW)


def _may_visit(now: Now, floor: str) -> bool:
    return floor != now.state.floor and _memory(now, floor).visits < now.config.floor_visits


def _evidence(now: Now, floor: str) -> float:
    """How surely a floor's cameras saw the target; nothing once the floor is searched or something there was
    looked at and dropped: that is most likely what they saw."""
    known = _memory(now, floor)
    if known.exhausted or known.dropped:
        return 0.0
    return float(now.summaries.get(floor, {}).get(now.state.target, 0.0))


def _evidence_here(now: Now) -> float:
    """The same for the robot's floor: what the joint map makes of it, once the cameras' views must have come."""
    state = now.state
    if state.here.scan_left != 0:
        return _evidence(now, state.floor)
    weak = objects.targets_of(now.maps.objects, state, now.config, weak=True)
    return max([objects.relevance(o, state.target) for o in weak], default=0.0)


def _tempting(now: Now) -> Errand | None:
    """The floor not visited yet, with a way to it that is worth it, whose cameras saw the target surely, and more surely
    than anything here is it."""
    state, config = now.state, now.config
    found = {floor: _evidence(now, floor) for floor in sorted(now.summaries) if not _memory(now, floor).visits}
    enough = max(config.floor_confidence, _evidence_here(now) + config.floor_margin)
    found = {floor: evidence for floor, evidence in found.items() if evidence >= enough}
    ways = _ways(now) if found else {}
    best = max((floor for floor in found if floor in ways), key=lambda floor: found[floor], default=None)
    if best is None:
        return None
    # going there pays where there is none here: if there is one, exploring finds it on a shorter way
    here = _chance_here(now)
    worth = objects.chance_of(found[best], state.target, config) / (ways[best][0] + config.floor_m)
    if exploring_is_worth(now, more_than=worth * (1.0 - here) / here):
        return None
    return Errand(best, f"the cameras of floor {best} saw {state.target!r} with {found[best]:.2f}", worth)


def _prior(now: Now) -> float:
    return now.config.floor_chances.get(now.state.target, now.config.floor_chance)


def _surely_here(now: Now) -> bool:
    """Whether the robot was told that its floor has the target: it then never leaves it."""
    return _prior(now) >= 1.0


def _chance_here(now: Now) -> float:
    """How likely the target is on the robot's floor although its cameras didn't see it: at first as floors of training
    buildings have one, then, by Bayes, the less, the farther the robot went on it without finding it."""
    target, config = now.state.target, now.config
    prior = _prior(now)
    found_per_m = config.explore_chances.get(target, config.explore_chance) / config.explore_m
    walked_m = sum(math.dist(a, b) for a, b in itertools.pairwise(now.state.here.visited))
    missed = math.exp(-found_per_m * walked_m)
    return max(prior * missed / (prior * missed + 1.0 - prior), 1e-6)


def _stands(now: Now, errand: Errand) -> bool:
    """Whether there is still a reason to go: this floor is searched, or those cameras didn't take it back."""
    if now.state.here.exhausted:
        return True
    return _evidence(now, errand.to_floor) >= now.config.floor_confidence - now.config.floor_margin


# --- stairs -----------------------------------------------------------------------------------------------------------


def _ways(now: Now) -> dict[str, tuple[float, Stair]]:
    """By floor that can be got to: the cost [m] of the cheapest way (Dijkstra over stairs) and its first stair."""
    stairs, tries = now.robot.stairs, now.config.stairs_tries
    order = itertools.count()  # decides between equals, always the same
    queue: list[tuple[float, int, Stair, Stair]] = []
    for stair in stairs:
        if stair.floor == now.state.floor and _usable(now, stair):
            way_m = float(now.arrival[_foot(now, stair)].min(initial=math.inf))
            if math.isfinite(way_m):
                heapq.heappush(queue, (way_m + stair.length_m, next(order), stair, stair))
    best: dict[str, tuple[float, Stair]] = {}
    done: set[int] = set()
    while queue:
        cost_m, _, first, last = heapq.heappop(queue)
        if id(last) in done:
            continue
        done.add(id(last))
        best.setdefault(last.to_floor, (cost_m, first))
        for stair in stairs:
            if stair.floor != last.to_floor or stair.to_floor == now.state.floor or id(stair) in done:
                continue
            if _memory(now, stair.floor).stairs_failed.get(memory.stair_name(*stair.at_m[:2]), 0) < tries:
                walk_m = math.dist(last.to_m[:2], stair.at_m[:2])
                heapq.heappush(queue, (cost_m + walk_m + stair.length_m, next(order), first, stair))
    return best


def _usable(now: Now, stair: Stair) -> bool:
    """Whether a stair of this floor may be headed for: not barred, and seen or known anyway."""
    x_m, y_m = stair.at_m[:2]
    if now.state.here.stairs_failed.get(memory.stair_name(x_m, y_m), 0) >= now.config.stairs_tries:
        return False
    if now.config.stairs_known == "plan" or now.state.here.exhausted:
        return True
    return bool((now.terrain.disc(x_m, y_m, _SEEN_M) & (now.terrain.crop(now.maps.explored) != 0)).any())


def _reach_m(now: Now, stair: Stair) -> float:
    """How near to a stair's end the robot goes: nearer after every try that failed."""
    failed = now.state.here.stairs_failed.get(memory.stair_name(*stair.at_m[:2]), 0)
    return max(now.config.stairs_reach_m * 0.5**failed, now.terrain.grid.resolution_m)


def _foot(now: Now, stair: Stair) -> NDArray[np.bool_]:
    """Cells of the terrain from which a stair can be taken: near its end, nothing mapped in between, a way leads there."""
    x_m, y_m = stair.at_m[:2]
    near = now.terrain.disc(x_m, y_m, _reach_m(now, stair)) & np.isfinite(now.arrival)
    cells = np.argwhere(near)
    end = np.broadcast_to(now.terrain.cell(x_m, y_m), cells.shape)
    near[cells[:, 0], cells[:, 1]] = clear_lines(now.terrain.occupied, cells, end)
    return near


def _to_stair(now: Now, stair: Stair) -> Decision | None:
    """Drives to a stair and takes it; None, with one try less, if that can't be."""
    state, robot, errand = now.state, now.robot, now.state.errand
    assert errand is not None
    (x_m, y_m), goals = stair.at_m[:2], _foot(now, stair)
    now.weighed[:] = [Candidate("stairs", x_m, y_m, 0.0, True, errand.why[:120])]
    now.commit(now.weighed[0])
    away_m = math.hypot(x_m - robot.x_m, y_m - robot.y_m)
    if away_m <= _reach_m(now, stair) and goals[now.terrain.cell(robot.x_m, robot.y_m)]:
        n_steps = max(1, math.ceil((away_m + stair.length_m) / now.config.step_m - 1e-9))
        state.taking = x_m, y_m, n_steps
        state.step += n_steps - 1
        memory.rest(state)
        message = f"taking the stairs to floor {stair.to_floor}: {errand.why}"
        return now.decide("take_stairs", "changing floor", message, to_floor=stair.to_floor)
    route = now.drive(goals)
    if route is None:
        now.weighed.clear()
        return None
    message = f"to the stairs to floor {stair.to_floor}, {route.remaining_m:.1f} m: {errand.why}"
    return now.level() or now.decide(route.action, "changing floor", message, route)
