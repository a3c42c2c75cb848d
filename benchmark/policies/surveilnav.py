"""Ours, and the paper to the letter (arXiv 2606.25119).

The paper: values averaged (eq. 2), association by box IoU (eq. 3), an object confirmed as soon as the higher of both
confidences passes a threshold and rejected for good when its class changes; a confirmed target first, then a promising
candidate, then the frontier of the highest value whatever the way costs; no camera chooses a floor, and what was
rejected stays so. Where it is silent its maps are VLN-Game's and its driving is ours.
"""

from __future__ import annotations

from surveilnav.benchmark.policies.mission import MissionPolicy
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig

#: A confirmed target before all else, any candidate before exploring, then the frontier of the highest value; what was
#: rejected stays so.
AS_WRITTEN = PlannerConfig(
    strategy="region",
    verification="paper",
    choice="paper",
    promising_chance=0.0,
    exploit="always",
    frontier_score="value",
    switch_ratio=1.0,
    last_resort_chance=None,
)

OURS = Policy(
    "surveilnav",
    "ours: a learned sense of place, what cameras saw first, two-level verification",
    lambda task: MissionPolicy(task, PlannerConfig(), summaries=True),
    FusionConfig(),
)
PAPER = Policy(
    "surveilnav-paper",
    "the paper to the letter: averaged values, stops at whatever is confirmed (arXiv 2606.25119)",
    lambda task: MissionPolicy(task, AS_WRITTEN),
    FusionConfig.preset("paper"),
)
