"""Ours, and the paper to the letter."""

from __future__ import annotations

from benchmark.policies.mission import Mission
from benchmark.policies.policy import Policy
from services.fusion.core import FusionConfig
from services.planner.core import PlannerConfig

OURS = Policy(
    "surveilnav",
    "ours: region values or nearest, what cameras saw first, two-level verification",
    lambda task: Mission(task, PlannerConfig(), summaries=True),
    FusionConfig(),
)
PAPER = Policy(
    "surveilnav-paper",
    "the paper to the letter: averaged values, stops at whatever is confirmed (arXiv 2606.25119)",
    lambda task: Mission(task, PlannerConfig(verification="paper")),
    FusionConfig.preset("paper"),
)
