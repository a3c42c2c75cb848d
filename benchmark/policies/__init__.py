"""Ways to search, all on the same joint maps: ours, those of others by their papers' facts, and upper bounds."""

from __future__ import annotations

from surveilnav.benchmark.policies.apexnav import APEXNAV, APEXNAV_VERIFIED
from surveilnav.benchmark.policies.cow import COW, COW_VERIFIED
from surveilnav.benchmark.policies.esc import ESC, ESC_VERIFIED
from surveilnav.benchmark.policies.frontier import FRONTIER
from surveilnav.benchmark.policies.l3mvn import L3MVN, L3MVN_VERIFIED
from surveilnav.benchmark.policies.language_model import LanguageModel
from surveilnav.benchmark.policies.llm import LLM
from surveilnav.benchmark.policies.perfect_frontiers import PERFECT_FRONTIERS
from surveilnav.benchmark.policies.policy import Policy, Searcher, Task, Truth
from surveilnav.benchmark.policies.random_places import RANDOM_SAMPLES, RANDOM_WALK
from surveilnav.benchmark.policies.shortest_path import SHORTEST_PATH
from surveilnav.benchmark.policies.surveilnav import OURS, PAPER
from surveilnav.benchmark.policies.vlfm import VLFM, VLFM_VERIFIED
from surveilnav.benchmark.policies.voronoi import VORONOI, VORONOI_VERIFIED
from surveilnav.errors import ConfigError

POLICIES: dict[str, Policy] = {
    policy.name: policy
    for policy in (
        OURS,
        PAPER,
        RANDOM_WALK,
        RANDOM_SAMPLES,
        FRONTIER,
        COW,
        COW_VERIFIED,
        VLFM,
        VLFM_VERIFIED,
        L3MVN,
        L3MVN_VERIFIED,
        ESC,
        ESC_VERIFIED,
        VORONOI,
        VORONOI_VERIFIED,
        APEXNAV,
        APEXNAV_VERIFIED,
        LLM,
        PERFECT_FRONTIERS,
        SHORTEST_PATH,
    )
}


def policy_of(name: str) -> Policy:
    """The policy of a name. ConfigError: there is none; the message lists them."""
    if name not in POLICIES:
        raise ConfigError(f"there is no policy {name!r}; choose one of {', '.join(POLICIES)}")
    return POLICIES[name]


__all__ = ["POLICIES", "LanguageModel", "Policy", "Searcher", "Task", "Truth", "policy_of"]
