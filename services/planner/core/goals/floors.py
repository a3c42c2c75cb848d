"""Which floor the target may be on: what each floor's cameras saw, and what the robot's own floor promises.

The cameras of every floor report what they last saw (``summaries``, a few hundred bytes a camera).
"""

from __future__ import annotations

import itertools
import math

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.state import FloorMemory

_NEW = FloorMemory()


def memory_of(context: StepContext, floor: str) -> FloorMemory:
    """What the mission remembers of a floor; of one that it was never on, nothing."""
    return context.state.floors.get(floor, _NEW)


def may_visit(context: StepContext, floor: str) -> bool:
    """Whether the robot may go to a floor: it isn't there, and wasn't there too often."""
    return floor != context.state.floor and memory_of(context, floor).visits < context.config.floor_visits


def evidence(context: StepContext, floor: str) -> float:
    """How surely a floor's cameras saw the target; nothing once the floor is searched or something there was
    looked at and dropped: that is most likely what they saw."""
    known = memory_of(context, floor)
    if known.exhausted or known.dropped:
        return 0.0
    return float(context.summaries.get(floor, {}).get(context.state.target, 0.0))


def evidence_here(context: StepContext) -> float:
    """The same for the robot's floor: what the joint map makes of it, once the first look around
    is over: the cameras' views are in it by then."""
    state = context.state
    if state.here.scan_left != 0:
        return evidence(context, state.floor)
    known = objects.candidates(context.maps.objects, state, context.config)
    return max([objects.chance(o, state.target) for o in known], default=0.0)


def surely_here(context: StepContext) -> bool:
    """Whether the robot was told that its floor has the target: it then never leaves it."""
    return context.config.floor_chance >= 1.0


def chance_here(context: StepContext) -> float:
    """How likely the target is on the robot's floor although its cameras didn't see it: at first as floors of training
    buildings have one, then, by Bayes, the less, the farther the robot went on it without finding it."""
    config = context.config
    prior = config.floor_chance
    found_per_m = config.explore_chance / config.explore_m
    walked_m = sum(math.dist(a, b) for a, b in itertools.pairwise(context.state.here.visited))
    missed = math.exp(-found_per_m * walked_m)
    return max(prior * missed / (prior * missed + 1.0 - prior), 1e-6)


def seen_elsewhere(context: StepContext) -> str:
    """The floor, not searched, whose cameras saw the target surely enough; "" if none did."""
    found = {f: evidence(context, f) for f in sorted(context.summaries) if f != context.state.floor}
    best = max(found, key=lambda floor: found[floor], default="")
    return best if best and found[best] >= context.config.floor_confidence else ""


def what_was_barred(context: StepContext) -> str:
    """Which stairs of this floor to floors not searched the robot couldn't take, for people; "" if none."""
    if surely_here(context):
        return ""
    barred = [
        f"{memory.stair_name(*s.at_m[:2])} to floor {s.to_floor}"
        for s in context.robot.stairs
        if s.floor == context.state.floor and not memory_of(context, s.to_floor).exhausted
    ]
    return f"the stairs at {', '.join(sorted(barred))} couldn't be reached or taken" if barred else ""
