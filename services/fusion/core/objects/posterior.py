"""How likely an object is of each class, from all that was seen of it.

The surest detection of a class says how likely the object is one, by what it looks like (its log-odds). Other detections
look alike: what they add is that the object was called so again. Each such view multiplies the odds by ``again``, and each view
that calls it something else, or nothing though it is in plain sight, by ``missed``.

Views err alike. The sum of n pieces of evidence that correlate by rho is divided by 1 + (n - 1) rho: for normal ones with equal
correlations, that is their log-likelihood ratio. So it goes with the views from one direction, and with what directions say.

An object is of one of the classes that views have named, or something else. The odds of each count by its share of all
detections.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from surveilnav.services.fusion.core.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.view_evidence import Direction, Look

_BEYOND = 30.0  # log-odds past which nothing changes


def posterior(looks: Mapping[Direction, Look], config: PosteriorConfig) -> dict[str, float]:
    """Chance 0-1 by class that a view has named; what is left to 1 is something else."""
    seen = list(looks.values())
    hits: dict[str, int] = {}
    for look in seen:
        for label, n in look.hits.items():
            hits[label] = hits.get(label, 0) + n
    everything = sum(hits.values())
    odds = {}
    for label in sorted(hits):
        log_odds = max(-_BEYOND, min(_BEYOND, _log_odds(label, seen, config)))
        odds[label] = hits[label] / everything * math.exp(log_odds)
    total = 1.0 + sum(odds.values())
    return {label: of / total for label, of in odds.items()}


def _log_odds(label: str, looks: Collection[Look], config: PosteriorConfig) -> float:
    """Of one class, named by some look, against something else."""
    again, missed = math.log(config.again), math.log(config.missed)
    said, best = -again, -math.inf  # the first detection made the object: it repeats nothing
    for look in looks:
        n, n_views = look.hits.get(label, 0), look.named + look.misses
        said += (n * again + (n_views - n) * missed) / _alike(n_views, config)
        if n:
            best = max(best, look.best[label])
    return best + said / _alike(len(looks), config)


def _alike(n: int, config: PosteriorConfig) -> float:
    """What the sum of n pieces of evidence is divided by."""
    return 1.0 + max(0, n - 1) * config.alike
