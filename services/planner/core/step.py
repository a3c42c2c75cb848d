"""One step of a mission: the paper's waypoint selection and navigation, extended to several floors.

    scan the surroundings -> choose a waypoint -> drive

Every activity is bounded, so every mission ends: scans, looks at objects, turns at frontiers, visits to a floor and failures
of stairs are counted, a waypoint without progress is blacklisted, and one that failed twice (a confirmed target: four times)
stays so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.context import FrontierRule, StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.floors import describe_failed_stairs, floor_with_evidence
from surveilnav.services.planner.core.goals.frontier_choice import best_frontier
from surveilnav.services.planner.core.goals.unchosen_objects import unchosen_objects
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.drive import FmmPlanner, LocalPlanner
from surveilnav.services.planner.core.motion.waypoint_driving import WaypointPlanner, to_drive
from surveilnav.services.planner.core.stages.initial_scan import initial_scan
from surveilnav.services.planner.core.stages.last_resort import accept_when_steps_run_out
from surveilnav.services.planner.core.stages.leaving import leave_area
from surveilnav.services.planner.core.stages.objects import leave_outdone_object
from surveilnav.services.planner.core.stages.rounds import first_decision

_PLANNERS: Mapping[str, LocalPlanner] = {"actions": FmmPlanner(), "waypoints": WaypointPlanner()}
_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}


def step(
    state: MissionState,
    maps: FloorMaps,
    robot: RobotView,
    config: PlannerConfig,
    planner: LocalPlanner | None = None,
    summaries: Mapping[str, Mapping[str, float]] = _NO_SUMMARIES,
    rule: FrontierRule = best_frontier,
) -> tuple[MissionState, Decision]:
    """Decides the next action of a mission on what the maps hold now.

    Refused stairs needn't be reported: called again with the robot still on the old floor, the step counts a failure and
    goes nearer to them or tries others.

    Args:
        state: what the mission remembers; not changed.
        maps: the joint maps of the robot's floor, with the robot's observation ``robot.seq`` integrated.
        robot: the robot at that observation.
        planner: drives to goal cells; None: the one that fits how the robot drives.
        summaries: by floor, label -> highest confidence that the cameras of that floor last reported.
        rule: chooses the frontier to explore.

    Returns:
        The new memory and the decision. ``found`` comes with the action ``stop``; a failure has an error name and no action.
    """
    state = state.copy()
    state.record_robot(robot, config)
    state.record_removals(maps.removals)
    planner = planner or _PLANNERS[config.drive]
    context = StepContext.from_inputs(state, maps, robot, config, planner, summaries, rule)
    decision = (
        _fail_if_spent(context) or leave_area(context) or initial_scan(context) or _choose_waypoint_and_drive(context)
    )
    if config.drive == "waypoints":
        decision = to_drive(decision, state, robot, config, context.leads_through_barred)
    state.record_decision(decision)
    candidates = decision.candidates + unchosen_objects(context, decision.candidates)
    return state, replace(decision, candidates=candidates)


def _choose_waypoint_and_drive(context: StepContext) -> Decision:
    """Tries the stages in their order; when none of them has anything left, the mission fails."""
    accept_when_steps_run_out(context)
    leave_outdone_object(context)
    return first_decision(context) or _nothing_left(context)


def _fail_if_spent(context: StepContext) -> Decision | None:
    """Fails the mission if its steps are used up or the robot is stuck for good; begins a recovery if it is stuck."""
    state, config, robot = context.state, context.config, context.robot
    if state.step >= state.max_steps:
        return _failure("out_of_steps", f"{state.max_steps} steps are used up without finding {state.target!r}")
    if not state.is_stuck(config):
        return None
    state.begin_recovery(config)
    if state.recoveries <= config.max_recoveries:
        return None
    place = f"({robot.x_m:.1f}, {robot.y_m:.1f})"
    return _failure("stuck", f"the robot didn't move on from {place} in {state.recoveries} tries")


def _nothing_left(context: StepContext) -> Decision:
    """Fails the mission because nothing is left to do, with the most specific reason."""
    state, failed_stairs = context.state, describe_failed_stairs(context)
    if state.recoveries:  # all was abandoned because the robot can't move
        return _failure("stuck", f"the robot didn't move on from ({context.robot.x_m:.1f}, {context.robot.y_m:.1f})")
    if state.unreachable_why:
        return _failure("unreachable", state.unreachable_why)
    if failed_stairs and (elsewhere := floor_with_evidence(context)):
        return _failure("unreachable", f"{state.target!r} was seen on floor {elsewhere!r}, but {failed_stairs}")
    message = f"nothing is left to explore or to look at, and {state.target!r} was not found"
    if state.failed_drives:
        message += (
            f"; the robot's own navigation gave up {state.failed_drives} ways, the last one: {state.failed_drive_why}"
        )
    return _failure("not_found", f"{message}; {failed_stairs}" if failed_stairs else message)


def _failure(error: str, message: str) -> Decision:
    return Decision(None, "finished", message, finished=True, error=error)
