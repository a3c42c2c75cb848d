"""What a recording says of its mission: when it begins, and when it ends."""

from __future__ import annotations

from surveilnav.messages import MissionStatus
from surveilnav.messages.recording import ONLY_FUSION
from surveilnav.perception.prompts import value_prompt


def mission_facts(mission: str, status: MissionStatus, building: str) -> dict[str, str]:
    """The facts that are known when a recording begins."""
    return {
        "mission": mission,
        "target": status.target,
        "robot": status.robot,
        "building": building,
        "started_ns": str(status.started_ns),
        "prompt": value_prompt(status.target),
    }


def outcome_facts(status: MissionStatus) -> dict[str, str]:
    """How the mission ended."""
    return {"state": status.state, "found": str(status.found).lower()}


def fact_name(name: str, fusion: str) -> str:
    """The name of a fact about the maps of a fusion service: of the only one, ``digest``; of one of several, ``digest low``."""
    return name if fusion == ONLY_FUSION else f"{name} {fusion}"
