"""Our joint object confirmation: one threshold on a probability, the same for all words.

It differs from the paper (section "Joint Object Confirmation") in three points:

- The confidence in a class is the probability that the object is of it, given all detections and misses of robots and cameras
  together (``posterior``).
- No category is decided for good: the object is of the most probable class at any time.
- A robot that looks from close by without detecting the object speaks against it.
- Cameras without a depth sensor guide the search. Once an object's place is measured, what they saw counts towards confirming it
  only if the object fills the box of their detection (``sighting_box``): else they may have seen another object before or
  behind it. It still counts against rejecting it.
"""

from __future__ import annotations

from surveilnav.services.fusion.core.objects.assessment import Assessment, Status
from surveilnav.services.fusion.core.objects.confidences import Confidences
from surveilnav.services.fusion.core.objects.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.posterior import posterior


class PosteriorConfirmation:
    """Our rule (see ``ConfirmationRule``)."""

    def __init__(self, config: PosteriorConfig) -> None:
        self._config = config

    def confidences(self, evidence: Evidence) -> Confidences:
        """The probability of each class by robots alone, by cameras alone, and by all."""
        robot, cameras = (
            posterior(evidence.by_direction.of_sources(*kinds), self._config)
            for kinds in (("robot",), ("camera", "estimate"))
        )
        return Confidences(robot, cameras, self._joint(evidence))

    def _joint(self, evidence: Evidence) -> dict[str, float]:
        return posterior(evidence.by_direction.of_sources("robot", "camera", "estimate"), self._config)

    def _measured(self, evidence: Evidence) -> dict[str, float]:
        """By those alone that measured the object's place; by all where nobody has."""
        measured = evidence.by_direction.of_sources("robot", "camera")
        if any(views.detections for views in measured.values()):
            return posterior(measured, self._config)
        return self._joint(evidence)

    def update(self, evidence: Evidence) -> None:
        """Does nothing, since this rule decides on no category for good."""

    def assess(self, evidence: Evidence, previous: Status) -> Assessment:
        c = self._config
        label, chance = Confidences({}, {}, self._measured(evidence)).maximum
        threshold = c.min_chance * (c.hysteresis if previous == "confirmed" else 1.0)
        n, directions, misses = evidence.count(label), len(evidence.by_direction), evidence.misses
        reason = f"{label} by {chance:.2f}: {n} detections, {directions} directions, {misses} misses"
        if chance >= threshold:
            return Assessment(label, chance, "confirmed", reason)
        label, chance = Confidences({}, {}, self._joint(evidence)).maximum
        if chance < c.reject_chance and misses:
            return Assessment(label, chance, "rejected", reason)
        return Assessment(label, chance, "candidate", f"{reason}; needs {threshold:g}")
