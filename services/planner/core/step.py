"""One step of a mission: the paper's waypoint selection and navigation, extended to several floors.

    perceive (StepContext) -> propose and choose (choice) -> drive (behaviours)

Which files say what: ``core/__init__.py``. What options are worth: ``options/__init__.py``.

Every activity is bounded, so every mission ends: scans, looks at objects, turns at frontiers, visits to a floor and failures
of stairs are counted, a waypoint without progress is blacklisted, and one that failed twice (a confirmed target: four times)
stays so. Only waiting for a door isn't bounded here; whoever runs the mission may cancel it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from surveilnav.messages import Candidate
from surveilnav.services.planner.core.behaviours.approach_object import approach_object
from surveilnav.services.planner.core.behaviours.explore_frontier import explore_frontier
from surveilnav.services.planner.core.behaviours.leave_area import leave_area
from surveilnav.services.planner.core.behaviours.look_around import look_around
from surveilnav.services.planner.core.behaviours.scan import initial_scan
from surveilnav.services.planner.core.behaviours.take_stairs import take_stairs
from surveilnav.services.planner.core.behaviours.wait_for_passage import wait_for_passage
from surveilnav.services.planner.core.choice import Choice, choose
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.context import FrontierRule, StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.goals.floors import describe_failed_stairs, floor_with_evidence
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.motion.drive import FmmPlanner, LocalPlanner
from surveilnav.services.planner.core.motion.waypoint_driving import WaypointPlanner, to_drive
from surveilnav.services.planner.core.options.frontiers import rule_of
from surveilnav.services.planner.core.options.option import Option, OptionKind
from surveilnav.services.planner.core.options.unchosen_objects import unchosen_objects

#: What is done about an option. None: it turned out that nothing can be, which was recorded.
BEHAVIOURS: Mapping[OptionKind, Callable[[StepContext, Option], Decision | None]] = {
    "target": approach_object,
    "candidate": approach_object,
    "frontier": explore_frontier,
    "stairs": take_stairs,
    "second_look": look_around,
    "passage": wait_for_passage,
}
#: Far more than there are options: reaching it means that one fails without a record of it.
_MAX_CHOICES = 1000
_MAX_SHOWN = 24
_PLANNERS: Mapping[str, LocalPlanner] = {"actions": FmmPlanner(), "waypoints": WaypointPlanner()}
_NO_SUMMARIES: Mapping[str, Mapping[str, float]] = {}


def step(
    state: MissionState,
    maps: FloorMaps,
    robot: RobotView,
    config: PlannerConfig,
    planner: LocalPlanner | None = None,
    summaries: Mapping[str, Mapping[str, float]] = _NO_SUMMARIES,
    rule: FrontierRule | None = None,
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
        rule: rates frontiers; None: by the strategy.

    Returns:
        The new memory and the decision. ``found`` comes with the action ``stop``; a failure has an error name and no action.
    """
    state = state.copy()
    state.record_robot(robot, config)
    state.record_removals(maps.removals)
    planner = planner or _PLANNERS[config.drive]
    context = StepContext.from_inputs(state, maps, robot, config, planner, summaries, rule or rule_of(config))
    decision = _fail_if_spent(context) or leave_area(context) or _choose_and_drive(context)
    if config.drive == "waypoints":
        decision = to_drive(decision, state, robot, config, context.leads_through_barred)
    state.record_decision(decision)
    candidates = decision.candidates + unchosen_objects(context, decision.candidates)
    return state, replace(decision, candidates=candidates)


def _choose_and_drive(context: StepContext) -> Decision:
    """Chooses an option and does something about it. If that shows that there is nothing to be done, chooses again.

    Raises:
        RuntimeError: options fail without end, which a behaviour that records no failure, or a frontier rule, can bring about.
    """
    choice = None
    for _ in range(_MAX_CHOICES):
        choice = choose(context)
        if decision := initial_scan(context, choice):
            return decision
        if choice is None:
            return _nothing_left(context)
        was_searched = context.state.here.is_searched
        context.state.apply(choice, context.config)
        if context.state.here.is_searched != was_searched:
            context = context.anew(context.state)
        if decision := BEHAVIOURS[choice.chosen.kind](context, choice.chosen):
            return replace(decision, candidates=_shown(choice))
    raise RuntimeError(f"an option is chosen without end: {choice}")


def _shown(choice: Choice) -> tuple[Candidate, ...]:
    """The options that were compared, as people are shown them."""
    options = choice.compared[:_MAX_SHOWN]
    return tuple(o.to_candidate(chosen=o is choice.chosen) for o in options if o.kind != "passage")


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
