"""Yamauchi's frontier-based exploration (CIRA 1997, https://doi.org/10.1109/CIRA.1997.613851): the nearest frontier.

Kept: frontiers between known free and unknown space, the nearest by way of driving next, one that can't be got to left
alone. The paper explores and looks for nothing; what is done about a target in sight is ours.
"""

from __future__ import annotations

from surveilnav.benchmark.policies.mission import MissionPolicy
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig

FRONTIER = Policy(
    "frontier",
    "the nearest frontier, Yamauchi 1997 (https://doi.org/10.1109/CIRA.1997.613851)",
    lambda task: MissionPolicy(task, PlannerConfig(strategy="greedy")),
    FusionConfig(),
)
