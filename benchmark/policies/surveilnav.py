"""Ours, and the paper to the letter (arXiv 2606.25119).

The paper: values averaged (eq. 2), association by box IoU (eq. 3), an object confirmed as soon as the higher of both
confidences passes a threshold and rejected for good when its class changes; a confirmed target first, then a promising
candidate, then the frontier of the highest value whatever the way costs; no camera chooses a floor, and what was
rejected stays so. Where it is silent its maps are VLN-Game's and its driving is ours.
"""

from __future__ import annotations

from benchmark.policies.mission import Mission
from benchmark.policies.policy import Policy
from services.fusion.core import FusionConfig
from services.planner.core import PlannerConfig

#: A confirmed target before all else, any candidate before exploring; values always decide unless they are all the same,
#: and only they do.
AS_WRITTEN = PlannerConfig(
    verification="paper", confirmed_chance=1e6, objects_first=True, exploit_min_std=1e-6, exploit_min_ratio=1.0,
    explore_m=1e6, value_gain=1e6, frontier_wide_m=1e-6, switch_ratio=1.0, promising_chance=0.0,
    settle_chance=2.0,
)  # fmt: skip

OURS = Policy(
    "surveilnav",
    "ours: region values or nearest, what cameras saw first, two-level verification",
    lambda task: Mission(task, PlannerConfig(), summaries=True),
    FusionConfig(),
)
PAPER = Policy(
    "surveilnav-paper",
    "the paper to the letter: averaged values, stops at whatever is confirmed (arXiv 2606.25119)",
    lambda task: Mission(task, AS_WRITTEN),
    FusionConfig.preset("paper"),
)
