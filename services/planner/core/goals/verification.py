"""Two-level verification: when to believe that an object is the target.

The paper has one level, fusion's joint object confirmation, and stops at what that confirms: ``verification="paper"``.
"""

from __future__ import annotations

from typing import Literal

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.goals.objects import chance, is_confirmed, robot_sees

#: What the joint map says of an object that the robot is at or heading for.
Verification = Literal["verified", "open", "contradicted"]


def verify(record: ObjectRecord, target: str, config: PlannerConfig) -> Verification:
    """The first level of verification: what the joint map says now.

    Returns:
        ``verified``: fusion confirmed the object and, unless ``verification`` is "paper", the robot sees it as the target.
        ``contradicted``: fusion rejected it, or the robot surely sees something else and so do all views together: one view
        of the robot doesn't outweigh what several cameras saw. ``open``: the robot has to look again.
    """
    if record.status == "rejected":
        return "contradicted"
    if config.verification == "paper":
        return "verified" if is_confirmed(record, target) else "open"
    if robot_sees(record, target, config) and is_confirmed(record, target):
        return "verified"
    is_something_else = target not in (record.label, record.label_robot) and record.label_robot != ""
    if is_something_else and record.confidence_robot >= config.verify_confidence_robot:
        return "contradicted"
    return "open"


def is_likely_enough(record: ObjectRecord, target: str, config: PlannerConfig) -> bool:
    """The second level, once all looks are taken: whether the object is more likely the target than what else could be found.

    The paper has no such level.
    """
    return config.verification != "paper" and chance(record, target) >= config.accept_chance
