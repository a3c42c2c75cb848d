"""What stages share about objects: what would have to outdo one, and setting out for it."""

from __future__ import annotations

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.goals.object_choice import ObjectGoal, floor_goal_worth, promising_object
from surveilnav.services.planner.core.pursuit.approach import approach
from surveilnav.services.planner.core.stages.exploring import put_off, weigh_exploring
from surveilnav.services.planner.core.stages.stage import RETRY, Retry
from surveilnav.services.planner.core.state import Decision


def go_to_promising(context: StepContext, *, confirmed: bool) -> Decision | Retry | None:
    """Goes to the best promising object if it is (not) ``confirmed``, and neither stairs nor exploring outdo it."""
    goal = promising_object(context)
    if goal is None or goal.confirmed != confirmed or _stairs_outdo(context, goal):
        return None
    exploring = weigh_exploring(context, least_worth(context, goal))
    put_off(context, exploring.hard)
    return None if exploring.outdoes else go_to(context, goal)


def go_to(context: StepContext, goal: ObjectGoal, *, unpromising: bool = False) -> Decision | Retry:
    """Commits to an object and approaches it. ``unpromising``: it is chosen since there is nothing better."""
    memory.commit(context.state, goal.choice.chosen, context.config, unpromising=unpromising)
    return approach(context, goal.record, goal.choice) or RETRY


def least_worth(context: StepContext, goal: ObjectGoal) -> float:
    """What another waypoint must be worth to be taken instead: clearly more while the robot is on its way to an object."""
    return goal.worth * (context.config.switch_ratio if goal.held else 1.0)


def _stairs_outdo(context: StepContext, goal: ObjectGoal) -> bool:
    """Whether the way to another floor that the robot is on is worth more than a candidate; a confirmed target is left
    for none."""
    return not goal.confirmed and goal.worth <= context.config.switch_ratio * floor_goal_worth(context)
