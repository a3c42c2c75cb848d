"""CLIP on Wheels (Gadre et al., CVPR 2023, https://arxiv.org/abs/2203.10421): the nearest frontier, until it sees the target.

Kept (https://github.com/real-stanford/cow): a full turn at the start, the nearest frontier next, whatever is beyond it, and as
soon as the localiser is sure of the target in one picture, straight there without looking again, and the stop at 1 m of it.
Not kept: CLIP's or OWL-ViT's relevance of pixels (a single detection of the backend that is sure enough stands in, as for VLFM),
frontiers in the order of straight lines (here of the way to drive), and that the map is thrown away where nothing is left to do
(floors and second looks are everybody's).
"""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.benchmark.policies.mission import MissionPolicy, first_sight
from surveilnav.benchmark.policies.policy import Policy
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.options.frontiers import only

CONFIG = PlannerConfig(verification="paper", choice="paper", standoff_m=0.95, stop_m=1.0)


def rate(context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
    """See ``FrontierRule``. The frontier that the robot drives to comes nearer at every step, so nothing else keeps it."""
    if not found:
        return []
    return only(context, min(found, key=lambda f: f.travel_time_m), found, "the nearest")


COW = Policy(
    "cow",
    "the nearest frontier until one picture shows the target, CLIP on Wheels (https://arxiv.org/abs/2203.10421)",
    lambda task: MissionPolicy(task, CONFIG, rate),
    first_sight(FusionConfig()),
)
#: Its rule alone, as for VLFM.
COW_VERIFIED = Policy(
    "cow-verified",
    "the nearest frontier, CLIP on Wheels (https://arxiv.org/abs/2203.10421), with our verification",
    lambda task: MissionPolicy(task, PlannerConfig(), rate),
    FusionConfig(),
)
