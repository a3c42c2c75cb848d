"""How likely an object is of each class, given everything that was seen of it (a naive Bayes update in log-odds).

The prior of a class comes from how the object looks: it is the log-odds of its surest detection. The other detections show the
same thing, so all they add is that the object was called by this class again. Each of them multiplies the odds by
``repeat_odds``. Each view that calls the object something else, or has it in plain sight without any detection, multiplies them
by ``miss_odds``.

Views err alike, so their evidence isn't independent. The sum of n log-likelihood ratios with pairwise correlation rho is divided
by the design effect ``1 + (n - 1) rho`` (Kish 1965); for normal variables of equal correlation that is their exact joint
log-likelihood ratio. It is applied twice: to the views from one direction, and to the sums of the directions.

An object is of one of the classes that views have named, or it is something else. Between classes, the odds of each are weighted
by its share of all detections.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from surveilnav.services.fusion.core.objects.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.view_evidence import Direction, ViewEvidence

_MAX_LOG_ODDS = 30.0  # beyond it, the probability is 0 or 1 to double precision for all that follows


def posterior(by_direction: Mapping[Direction, ViewEvidence], config: PosteriorConfig) -> dict[str, float]:
    """The probability (0-1) of each class that a view has named. The rest to 1 is that of something else."""
    evidence = list(by_direction.values())
    detections: dict[str, int] = {}
    for views in evidence:
        for label, n in views.detections.items():
            detections[label] = detections.get(label, 0) + n
    n_detections = sum(detections.values())
    n_views = [views.n_detecting_views + views.misses for views in evidence]
    odds = {}
    for label in sorted(detections):
        log_odds = max(-_MAX_LOG_ODDS, min(_MAX_LOG_ODDS, _log_odds(label, evidence, n_views, config)))
        odds[label] = detections[label] / n_detections * math.exp(log_odds)
    total = 1.0 + sum(odds.values())
    return {label: class_odds / total for label, class_odds in odds.items()}


def _log_odds(label: str, evidence: Sequence[ViewEvidence], n_views: Sequence[int], config: PosteriorConfig) -> float:
    """The log-odds of one class, which some view has named, against something else.

    Args:
        n_views: line by line with the evidence, the number of its views.
    """
    repeat, miss = math.log(config.repeat_odds), math.log(config.miss_odds)
    update, prior = -repeat, -math.inf  # the first detection created the object and repeats nothing
    for views, n_all in zip(evidence, n_views, strict=True):
        n = views.detections.get(label, 0)
        update += (n * repeat + (n_all - n) * miss) / _design_effect(n_all, config)
        if n:
            prior = max(prior, views.max_log_odds[label])
    return prior + update / _design_effect(len(evidence), config)


def _design_effect(n: int, config: PosteriorConfig) -> float:
    """What the sum of n correlated pieces of evidence is divided by."""
    return 1.0 + max(0, n - 1) * config.correlation
