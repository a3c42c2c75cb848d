"""The planner's answers to a goal, a cancel, a pause and a resume."""

from __future__ import annotations

from surveilnav.bus import Answer, clock_ns
from surveilnav.messages import MissionAck
from surveilnav.services.planner.mission_runner import MissionRunner


def acknowledged(mission: MissionRunner, *, accepted: bool, message: str = "") -> Answer:
    """The mission's state, and whether it does what was asked."""
    return Answer(
        MissionAck(
            stamp_ns=clock_ns(),
            mission=mission.id,
            accepted=accepted,
            state=mission.status.state,
            robot=mission.robot,
            target=mission.status.target,
            message=message,
        )
    )


def refused(mission: str, error: str, message: str) -> Answer:
    """Why nothing is done; ``error`` is a name of the contract."""
    ack = MissionAck(stamp_ns=clock_ns(), mission=mission, accepted=False, state="failed", error=error, message=message)
    return Answer(ack)
