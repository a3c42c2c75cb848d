"""What stages share about objects: which of them beats exploring and stairs, and going there."""

from __future__ import annotations

from surveilnav.services.planner.core.behaviours.approach_object import approach_object
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.object_choice import ObjectGoal, current_stairs_utility, promising_object
from surveilnav.services.planner.core.stages.exploring import compare_exploring, defer
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def go_to_promising(context: StepContext, *, confirmed: bool) -> Decision | Retry | None:
    """Goes to the best promising object if it is (or isn't) ``confirmed``, and neither stairs nor exploring are better."""
    goal = promising_object(context)
    if goal is None or goal.confirmed != confirmed or _stairs_are_better(context, goal):
        return None
    exploring = compare_exploring(context, utility_to_beat(context, goal))
    defer(context, exploring.constrained)
    return None if exploring.is_better else go_to(context, goal)


def go_to(context: StepContext, goal: ObjectGoal, *, is_fallback: bool = False) -> Decision | Retry:
    """Commits to an object and approaches it. ``is_fallback``: it was chosen only because nothing better is left."""
    context.state.commit_to(goal.choice.chosen, context.config, is_fallback=is_fallback)
    return approach_object(context, goal.record, goal.choice) or RETRY


def utility_to_beat(context: StepContext, goal: ObjectGoal) -> float:
    """The utility above which exploring is chosen instead: clearly more while the robot is heading for an object."""
    return goal.utility * (context.config.switch_ratio if goal.has_current else 1.0)


def _stairs_are_better(context: StepContext, goal: ObjectGoal) -> bool:
    """Whether the stairs that the robot is heading for have a higher utility than a candidate, with hysteresis. Stairs never
    outdo a confirmed target."""
    return not goal.confirmed and goal.utility <= context.config.switch_ratio * current_stairs_utility(context)
