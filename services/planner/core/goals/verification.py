"""Two-level verification: when to believe that an object is the target.

The paper has one level, fusion's joint object confirmation, and stops at what that confirms: ``verification="paper"``.
"""

from __future__ import annotations

from typing import Literal

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.goals.objects import chance, is_confirmed, robot_sees

#: What the joint map says of an object that the robot is at or on its way to.
Verification = Literal["verified", "open", "contradicted"]


def verify(record: ObjectRecord, target: str, config: PlannerConfig) -> Verification:
    """The first level of verification: what the joint map says now.

    ``verified``: confirmed by fusion and, unless ``verification`` is ``paper``, seen as the target by the robot.
    ``contradicted``: rejected, or the robot surely sees something else and all views together do, too: one robot view
    doesn't outweigh what several cameras saw. ``open``: look once more.
    """
    if record.status == "rejected":
        return "contradicted"
    if config.verification == "paper":
        return "verified" if is_confirmed(record, target) else "open"
    if robot_sees(record, target, config) and is_confirmed(record, target):
        return "verified"
    another = target not in (record.label, record.label_robot) and record.label_robot != ""
    if another and record.confidence_robot >= config.verify_confidence_robot:
        return "contradicted"
    return "open"


def good_enough(record: ObjectRecord, target: str, config: PlannerConfig) -> bool:
    """The second level, when looking again is no use: after all looks the object is likelier the target than what else could
    be found. The paper has no such level."""
    return config.verification != "paper" and chance(record, target) >= config.accept_chance
