"""Our joint object confirmation: one chance for all words.

What differs from the paper (section "Joint Object Confirmation"):

- The confidence of a class is how likely the object is of it, from all detections and missed sightings of robots and
  cameras together (``posterior``).
- Nothing is settled for good: the class is the likeliest at any time.
- A robot that looks closely and doesn't see the object speaks against it.
"""

from __future__ import annotations

from surveilnav.services.fusion.core.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.assessment import Assessment, Status
from surveilnav.services.fusion.core.objects.confidences import Confidences
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.posterior import posterior
from surveilnav.services.fusion.core.objects.view_evidence import of_kinds


class PosteriorConfirmation:
    """See ``Confirmation``."""

    def __init__(self, config: PosteriorConfig) -> None:
        self._config = config

    def confidences(self, evidence: Evidence) -> Confidences:
        """Chances of each class: by robots alone, by cameras alone, and by all."""
        robot, cameras = (posterior(of_kinds(evidence.looks, kind), self._config) for kind in ("robot", "camera"))
        return Confidences(robot, cameras, self._joint(evidence))

    def _joint(self, evidence: Evidence) -> dict[str, float]:
        return posterior(of_kinds(evidence.looks, "robot", "camera"), self._config)

    def settle(self, evidence: Evidence) -> None:
        """Nothing is settled: the class is the likeliest at any time."""

    def assess(self, evidence: Evidence, was: Status) -> Assessment:
        """See ``Confirmation``."""
        c = self._config
        label, chance = Confidences({}, {}, self._joint(evidence)).maximum
        needed = c.min_chance * (c.hysteresis if was == "confirmed" else 1.0)
        n, directions, misses = evidence.count(label), len(evidence.looks.of), evidence.misses
        by = f"{label} by {chance:.2f}: {n} detections, {directions} directions, {misses} misses"
        if chance >= needed:
            return Assessment(label, chance, "confirmed", by)
        if chance < c.reject_chance and misses:
            return Assessment(label, chance, "rejected", by)
        return Assessment(label, chance, "candidate", f"{by}; needs {needed:g}")
