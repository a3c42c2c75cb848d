"""The order in which kinds of waypoints are tried.

The paper's order is: a confirmed target, else a promising candidate, else the best frontier (its section on waypoint
selection). Ours adds other floors, and what is left when all is explored.
"""

from __future__ import annotations

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision
from surveilnav.services.planner.core.stages.closed_passage import closed_passage
from surveilnav.services.planner.core.stages.exploring import constrained_frontier, frontier
from surveilnav.services.planner.core.stages.last_resort import last_resort
from surveilnav.services.planner.core.stages.next_floor import next_floor
from surveilnav.services.planner.core.stages.objects import any_candidate, confirmed_target, promising_candidate
from surveilnav.services.planner.core.stages.other_floor import other_floor
from surveilnav.services.planner.core.stages.second_look import second_look
from surveilnav.services.planner.core.stages.stage import RETRY, Retry, Stage


def retry_blacklisted(context: StepContext) -> Retry | None:
    """Releases all places of the floor that aren't blacklisted permanently: the map may have changed. None: there is none."""
    return RETRY if context.state.release_blacklisted() else None


#: Rounds of stages. The stages of a round are tried in order until one decides. A stage that returns ``RETRY`` has its round
#: begin again; when no stage of a round has anything left, the next round begins. Whatever leads to a retry is counted in the
#: mission's memory, so the retries end.
ROUNDS: tuple[tuple[Stage, ...], ...] = (
    (confirmed_target, promising_candidate, other_floor, frontier, retry_blacklisted),
    (any_candidate, other_floor, retry_blacklisted, next_floor, second_look),
    (any_candidate, other_floor, constrained_frontier, retry_blacklisted, closed_passage, last_resort),
)


#: Far more than there are waypoints: reaching it means that a stage or a frontier rule abandons nothing and still retries.
_MAX_RETRIES = 10_000


def first_decision(context: StepContext) -> Decision | None:
    """The decision of the first stage that makes one; None: nothing is left to do.

    Raises:
        RuntimeError: a stage retries without end.
    """
    for stages in ROUNDS:
        for _ in range(_MAX_RETRIES):
            outcome = next((outcome for stage in stages if (outcome := stage(context)) is not None), None)
            if not isinstance(outcome, Retry):
                break
        else:
            raise RuntimeError(f"a stage of {[s.__name__ for s in stages]} retries without end")
        if outcome is not None:
            return outcome
    return None
