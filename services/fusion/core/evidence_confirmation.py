"""Our joint object confirmation: the paper's, with evidence from several places for it and missed sightings against it.

What differs from the paper (section "Joint Object Confirmation"):

- The confidence of a class is its share of all evidence. Other classes and missed sightings count 0 (ApexNav's rule).
- A class is settled by a few detections. Only a few weightier ones of another class change it, and a changed object may
  be confirmed later on.
- An object needs near detections from different places, or many camera views, and no strong rival.
- A robot that looks closely and doesn't see the object speaks against it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from services.fusion.core.assessment import Assessment, Status
from services.fusion.core.class_priors import PRIORS
from services.fusion.core.confidences import Confidences
from services.fusion.core.config import EvidenceConfirmationConfig, FalsePositiveConfig
from services.fusion.core.evidence import NOTHING, Evidence, Support

_USUAL_RECALL = 0.8  # of classes that data/coco/priors.json doesn't name


class EvidenceConfirmation:
    """See ``Confirmation``."""

    def __init__(self, config: EvidenceConfirmationConfig, false_positives: FalsePositiveConfig) -> None:
        self._config, self._false_positives = config, false_positives
        by_class = config.class_priors
        self._min_confidence = PRIORS.min_confidence if by_class else {}
        self._margin = PRIORS.margin if by_class else {}
        self._min_sightings = PRIORS.min_sightings if by_class else {}

    def weigh(self, range_m: float, *, is_robot: bool) -> tuple[float, bool]:
        """Full weight within ``near_m``, falling with the square of the range beyond; near is what a robot sees there."""
        weight = min(1.0, (self._config.near_m / max(range_m, 1e-6)) ** 2)
        return weight, is_robot and range_m <= self._config.near_m

    def confidences(self, evidence: Evidence) -> Confidences:
        """Weighted scores of each class over the weight of all evidence: other classes and misses count as 0."""
        return Confidences(
            self._shares(evidence.robot, evidence.misses), self._shares(evidence.surveillance, evidence.misses)
        )

    def _shares(self, supports: Mapping[str, Support], misses: int) -> dict[str, float]:
        everything = sum(s.weight for s in supports.values())
        return {
            label: s.weighted_score / (everything + misses * self._miss_weight(label)) for label, s in supports.items()
        }

    def _miss_weight(self, label: str) -> float:
        """A miss weighs by how much it surprises: -log of the share of views in which a thing of the class is missed."""
        return self._false_positives.miss_weight * math.log(1.0 - _recall(label)) / math.log(1.0 - _USUAL_RECALL)

    def settle(self, evidence: Evidence) -> None:
        """The class of the maximum is settled by ``flip_detections``; such a one, if weightier, also unseats another."""
        against = self._false_positives
        label, _ = self.confidences(evidence).maximum
        settled = evidence.settled
        if settled == label or evidence.count(label) < against.flip_detections:
            return
        if not settled:
            evidence.settled = label
        elif evidence.weight(label) >= against.flip_margin * evidence.weight(settled):
            evidence.flip(label)

    def assess(self, evidence: Evidence, was: Status) -> Assessment:
        """See ``Confirmation``."""
        confidences = self.confidences(evidence)
        label = evidence.settled or confidences.maximum[0]
        confidence = confidences.of(label)
        # false positives
        if reason := self._flipped(evidence, label) or self._missed(evidence, label):
            return Assessment(label, confidence, "rejected", reason)
        # too little is known, or it may as well be something else
        if reason := self._too_few(evidence, label) or self._rivalled(confidences, label):
            return Assessment(label, confidence, "candidate", reason)
        # seen often enough, from places enough, by sources that are sure enough
        if reason := self._confirmed(evidence, confidences, label, was):
            return Assessment(label, confidence, "confirmed", reason)
        return Assessment(label, confidence, "candidate", self._wanting(evidence, label, confidence))

    def _flipped(self, evidence: Evidence, label: str) -> str:
        """Why a change of class rejects; empty if it doesn't."""
        if evidence.flipped is None:
            return ""
        old, new, n_then = evidence.flipped
        if evidence.count(label) >= n_then + self._false_positives.revive_detections:
            return ""
        return f"false positive: first taken for {old}, then for {new}"

    def _missed(self, evidence: Evidence, label: str) -> str:
        """Why missed sightings reject; empty if they don't."""
        against, n_near = self._false_positives, evidence.robot.get(label, NOTHING).near
        expected = against.reject_share * _recall(label) * (n_near + evidence.misses)
        if evidence.misses < against.reject_misses or n_near >= expected:
            return ""
        return f"a robot had it in plain view {evidence.misses} times and saw no {label} ({n_near} times it did)"

    def _too_few(self, evidence: Evidence, label: str) -> str:
        """Why the class has too few detections; empty if it has enough."""
        n, least = evidence.count(label), self._config.min_detections
        return f"{n} of at least {least} detections of a {label}" if n < least else ""

    def _rivalled(self, confidences: Confidences, label: str) -> str:
        """Which other class is too likely; empty if none is."""
        confidence, (rival, rival_confidence) = confidences.of(label), confidences.rival(label)
        if self._margin.get(label, self._config.margin) * rival_confidence <= confidence:
            return ""
        return f"{label} {confidence:.2f}, but {rival} {rival_confidence:.2f}"

    def _confirmed(self, evidence: Evidence, confidences: Confidences, label: str, was: Status) -> str:
        """What confirms an object; empty if nothing does. Once confirmed, a little less will do: no flicker."""
        config, lenient = self._config, self._config.hysteresis if was == "confirmed" else 1.0
        robot, cameras = evidence.robot.get(label, NOTHING), evidence.surveillance.get(label, NOTHING)
        n_views = len(cameras.places)
        # by a robot that came near, with or without cameras
        if (
            robot.near >= 1
            and robot.near + n_views >= self._sightings_needed(label)
            and len(robot.places) + n_views >= config.min_viewpoints
            and confidences.of(label) >= lenient * self._confidence_needed(label, robot.near + n_views)
        ):
            return f"{label} {confidences.of(label):.2f} by {_sightings(evidence, label)}"
        # by cameras alone
        by_cameras = confidences.surveillance.get(label, 0.0)
        if n_views >= config.camera_views and by_cameras >= lenient * config.camera_confidence:
            return f"{label} {by_cameras:.2f} by {n_views} camera views"
        return ""

    def _wanting(self, evidence: Evidence, label: str, confidence: float) -> str:
        """What a candidate lacks."""
        robot, cameras = evidence.robot.get(label, NOTHING), evidence.surveillance.get(label, NOTHING)
        needed = self._confidence_needed(label, robot.near + len(cameras.places))
        lacks = f"confidence {confidence:.2f} < {needed:g}"
        if confidence >= needed:
            n = self._sightings_needed(label)
            lacks = f"needs {n} sightings, one of them a robot's within {self._config.near_m:g} m"
        return f"{lacks}; {_sightings(evidence, label)}, {evidence.misses} misses"

    def _sightings_needed(self, label: str) -> int:
        return self._min_sightings.get(label, self._config.min_sightings)

    def _confidence_needed(self, label: str, n_sightings: int) -> float:
        """An object that was seen only a few times needs more: a few views agree by chance."""
        config = self._config
        span = max(1, config.settled_sightings - config.min_sightings)
        early = config.early_confidence * min(1.0, max(0.0, (config.settled_sightings - n_sightings) / span))
        return self._min_confidence.get(label, config.min_confidence) + early


def _sightings(evidence: Evidence, label: str) -> str:
    robot, cameras = evidence.robot.get(label, NOTHING), evidence.surveillance.get(label, NOTHING)
    return f"{robot.near} near robot detections, {len(cameras.places)} camera views"


def _recall(label: str) -> float:
    return PRIORS.recall.get(label, _USUAL_RECALL)
