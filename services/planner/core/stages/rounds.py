"""The order in which waypoints are tried.

The paper's order: a confirmed target, else a promising candidate, else the best frontier (its section on waypoint selection).
Ours adds other floors, and what is left when all is explored.
"""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.stages.any_candidate import any_candidate
from surveilnav.services.planner.core.stages.confirmed_target import confirmed_target
from surveilnav.services.planner.core.stages.frontier import frontier
from surveilnav.services.planner.core.stages.hard_frontier import hard_frontier
from surveilnav.services.planner.core.stages.last_resort import last_resort
from surveilnav.services.planner.core.stages.next_floor import next_floor
from surveilnav.services.planner.core.stages.other_floor import other_floor
from surveilnav.services.planner.core.stages.promising_candidate import promising_candidate
from surveilnav.services.planner.core.stages.second_chance import second_chance
from surveilnav.services.planner.core.stages.second_look import second_look
from surveilnav.services.planner.core.stages.stage import Retry, Stage
from surveilnav.services.planner.core.state import Decision

#: Rounds of stages. A round is tried from its first stage until one decides; a stage that gave something up has its round
#: begin again; when a round has nothing left, the next begins. Every retry is counted in the mission's memory, so each ends.
ROUNDS: tuple[tuple[Stage, ...], ...] = (
    (confirmed_target, promising_candidate, other_floor, frontier, second_chance),
    (any_candidate, other_floor, second_chance, next_floor, second_look),
    (any_candidate, other_floor, hard_frontier, second_chance, last_resort),
)


#: Far more than there are waypoints: who comes here has a stage or a frontier rule that gives nothing up.
_MOST_RETRIES = 10_000


def first_decision(context: StepContext) -> Decision | None:
    """The first that a stage makes; None: there is nothing left to do."""
    for stages in ROUNDS:
        for _ in range(_MOST_RETRIES):
            outcome = _first_outcome(stages, context)
            if not isinstance(outcome, Retry):
                break
        else:
            raise RuntimeError(f"a stage of {[s.__name__ for s in stages]} retries without end")
        if outcome is not None:
            return outcome
    return None


def _first_outcome(stages: tuple[Stage, ...], context: StepContext) -> Decision | Retry | None:
    return next((outcome for stage in stages if (outcome := stage(context)) is not None), None)
