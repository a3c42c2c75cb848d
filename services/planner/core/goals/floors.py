"""Which floor the target may be on: what each floor's cameras saw, and what can be expected of the robot's own floor.

The cameras of every floor report what they last saw in summaries of a few hundred bytes each.
"""

from __future__ import annotations

import itertools
import math

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals import objects
from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
from surveilnav.services.planner.core.memory.floor_memory import FloorMemory, stairs_name

_NEVER_VISITED = FloorMemory()


def memory_of(context: StepContext, floor: str) -> FloorMemory:
    """What the mission remembers of a floor; an empty memory if the robot was never there."""
    return context.state.floors.get(floor, _NEVER_VISITED)


def may_visit(context: StepContext, floor: str) -> bool:
    """Whether the robot may go to a floor: it isn't there now and hasn't been there too often."""
    return floor != context.state.floor and memory_of(context, floor).visits < context.config.max_floor_visits


def evidence(context: StepContext, floor: str) -> float:
    """The highest confidence with which a floor's cameras reported the target.

    0 once the floor is searched, or an object there was dismissed: that is most likely what the cameras saw.
    """
    known = memory_of(context, floor)
    if known.is_searched or known.dismissed:
        return 0.0
    return float(context.summaries.get(floor, {}).get(context.state.target, 0.0))


def evidence_here(context: StepContext) -> float:
    """The evidence on the robot's own floor.

    Until the initial scan is over that is what its cameras report; from then on their views are in the joint map, and it is
    the chance of the likeliest object there.
    """
    state = context.state
    if state.here.scan_turns_left != 0:
        return evidence(context, state.floor)
    known = objects.candidates(context.possible_targets, state, context.config)
    return max([objects.chance(o, state.target) for o in known], default=0.0)


def never_leaves(context: StepContext) -> bool:
    """Whether the robot was told that the target is on its floor, so that it stays there."""
    return context.config.floor_chance >= 1.0


def is_still_wanted(context: StepContext, goal: FloorGoal) -> bool:
    """Whether there is still a reason to go to a floor: this one is searched, or that one's cameras still see the target."""
    if context.state.here.is_searched:
        return True
    return evidence(context, goal.to_floor) >= context.config.floor_confidence - context.config.floor_margin


def chance_here(context: StepContext) -> float:
    """The chance that the target is on the robot's floor although its cameras didn't see it.

    It begins with the prior ``floor_chance``, and falls by Bayes' rule with the distance that the robot travelled on the
    floor without finding the target.
    """
    config = context.config
    prior = config.floor_chance
    found_per_m = config.explore_chance / config.explore_cost_m
    walked_m = sum(math.dist(a, b) for a, b in itertools.pairwise(context.state.here.visited))
    missed = math.exp(-found_per_m * walked_m)
    return max(prior * missed / (prior * missed + 1.0 - prior), 1e-6)


def floor_with_evidence(context: StepContext) -> str:
    """The other floor with the highest evidence, if that is at least ``floor_confidence``; "" if there is none."""
    found = {f: evidence(context, f) for f in sorted(context.summaries) if f != context.state.floor}
    best = max(found, key=lambda floor: found[floor], default="")
    return best if best and found[best] >= context.config.floor_confidence else ""


def describe_failed_stairs(context: StepContext) -> str:
    """Which stairs of this floor to floors not searched couldn't be reached or taken, for people; "" if there are none."""
    if never_leaves(context):
        return ""
    failed = [
        f"{stairs_name(*s.at_m[:2])} to floor {s.to_floor}"
        for s in context.robot.stairs
        if s.floor == context.state.floor and not memory_of(context, s.to_floor).is_searched
    ]
    return f"the stairs at {', '.join(sorted(failed))} couldn't be reached or taken" if failed else ""
