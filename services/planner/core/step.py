"""One step of a mission: the paper's waypoint selection and navigation, on several floors.

    look around -> choose a waypoint -> drive

Every way out is bounded: scans, looks, peeks, visits to a floor and tries at a stair are counted, a waypoint without
progress is given up, and whatever is given up twice (a confirmed target: four times) stays so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.context import FrontierRule, StepContext
from surveilnav.services.planner.core.goals.floors import seen_elsewhere, what_was_barred
from surveilnav.services.planner.core.goals.frontier_choice import best_frontier
from surveilnav.services.planner.core.goals.passed_over import passed_over
from surveilnav.services.planner.core.motion.drive import FmmPlanner, LocalPlanner
from surveilnav.services.planner.core.stages.confirmed_target import let_go_of_lost_object
from surveilnav.services.planner.core.stages.last_resort import accept_when_steps_run_out
from surveilnav.services.planner.core.stages.look_around import look_around
from surveilnav.services.planner.core.stages.rounds import first_decision
from surveilnav.services.planner.core.state import Decision, MapView, MissionState, RobotView

_FMM = FmmPlanner()
_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}


def step(
    state: MissionState,
    maps: MapView,
    robot: RobotView,
    config: PlannerConfig,
    planner: LocalPlanner = _FMM,
    summaries: Mapping[str, Mapping[str, float]] = _NO_SUMMARIES,
    rule: FrontierRule = best_frontier,
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
    memory.arrive(state, robot)
    memory.remember(state, robot, config)
    context = StepContext.of(state, maps, robot, config, planner, summaries, rule)
    decision = _fail_if_spent(context) or look_around(context) or _choose_waypoint_and_drive(context)
    memory.note_decision(state, decision)
    weighed = decision.candidates + passed_over(context, decision.candidates)
    return state, replace(decision, candidates=weighed)


def _choose_waypoint_and_drive(context: StepContext) -> Decision:
    """By the stages, in their order; when none has anything left, the mission fails."""
    accept_when_steps_run_out(context)
    let_go_of_lost_object(context)
    return first_decision(context) or _nothing_left(context)


def _fail_if_spent(context: StepContext) -> Decision | None:
    """The steps are used up, or the robot is stuck for good; where it is only stuck, it turns to another waypoint."""
    state, config, robot = context.state, context.config, context.robot
    if state.step >= state.max_steps:
        return _failure("out_of_steps", f"{state.max_steps} steps are used up without finding {state.target!r}")
    if not memory.is_stuck(state, config):
        return None
    memory.escape(state, config)
    if state.escapes <= config.max_escapes:
        return None
    place = f"({robot.x_m:.1f}, {robot.y_m:.1f})"
    return _failure("stuck", f"the robot didn't move on from {place} in {state.escapes} tries")


def _nothing_left(context: StepContext) -> Decision:
    """Nothing is left to do: why."""
    state, stairs = context.state, what_was_barred(context)
    if state.escapes:  # it gave everything up because it can't move
        return _failure("stuck", f"the robot didn't move on from ({context.robot.x_m:.1f}, {context.robot.y_m:.1f})")
    if state.unreachable:
        return _failure("unreachable", state.unreachable)
    if stairs and (elsewhere := seen_elsewhere(context)):
        return _failure("unreachable", f"{state.target!r} was seen on floor {elsewhere!r}, but {stairs}")
    message = f"nothing is left to explore or to look at, and {state.target!r} was not found"
    return _failure("not_found", f"{message}; {stairs}" if stairs else message)


def _failure(error: str, message: str) -> Decision:
    return Decision(None, "finished", message, finished=True, error=error)
