"""Objects: those that are or may be the target, and when they beat exploring and stairs."""

from __future__ import annotations

from surveilnav.services.planner.core.behaviours.approach_object import approach_object
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.object_choice import (
    ObjectGoal,
    any_object,
    current_lost_promise,
    current_stairs_utility,
    promising_object,
)
from surveilnav.services.planner.core.stages.exploring import exploring_is_better
from surveilnav.services.planner.core.stages.stage import RETRY, Retry


def confirmed_target(context: StepContext) -> Decision | Retry | None:
    """Goes to an object that fusion confirmed as the target, unless a candidate or exploring has a higher utility."""
    return _go_to_promising(context, confirmed=True)


def promising_candidate(context: StepContext) -> Decision | Retry | None:
    """Goes to an object that isn't confirmed, but may well be the target, unless another floor or exploring is better."""
    return _go_to_promising(context, confirmed=False)


def any_candidate(context: StepContext) -> Decision | Retry | None:
    """All is explored, so unlikely and deferred objects get their turn, the one of the highest utility first."""
    goal = any_object(context)
    return None if goal is None else _go_to(context, goal, is_fallback=True)


def leave_outdone_object(context: StepContext) -> None:
    """Stops heading for an object that isn't promising any more, or that exploring now clearly outdoes."""
    waypoint = context.state.waypoint
    if waypoint is None or waypoint.object_id is None:
        return
    goal = promising_object(context)
    is_outdone = goal is not None and goal.has_current and exploring_is_better(context, _utility_to_beat(context, goal))
    if is_outdone or current_lost_promise(context):
        context.state.record_oscillation()


def _go_to_promising(context: StepContext, *, confirmed: bool) -> Decision | Retry | None:
    """Goes to the best promising object if it is (or isn't) ``confirmed``, and neither stairs nor exploring are better."""
    goal = promising_object(context)
    if goal is None or goal.confirmed != confirmed or _stairs_are_better(context, goal):
        return None
    return None if exploring_is_better(context, _utility_to_beat(context, goal)) else _go_to(context, goal)


def _go_to(context: StepContext, goal: ObjectGoal, *, is_fallback: bool = False) -> Decision | Retry:
    """Commits to an object and approaches it. ``is_fallback``: it was chosen only because nothing better is left."""
    context.state.commit_to(goal.choice.chosen, context.config, is_fallback=is_fallback)
    return approach_object(context, goal.record, goal.choice) or RETRY


def _utility_to_beat(context: StepContext, goal: ObjectGoal) -> float:
    """The utility above which exploring is chosen instead: clearly more while the robot is heading for an object."""
    return goal.utility * (context.config.switch_ratio if goal.has_current else 1.0)


def _stairs_are_better(context: StepContext, goal: ObjectGoal) -> bool:
    """Whether the stairs that the robot is heading for have a higher utility than a candidate, with hysteresis. Stairs never
    outdo a confirmed target."""
    return not goal.confirmed and goal.utility <= context.config.switch_ratio * current_stairs_utility(context)
