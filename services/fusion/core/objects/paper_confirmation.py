"""The paper's joint object confirmation, to the letter (section "Joint Object Confirmation").

    The confidence of an object is the maximum over the robot's and the surveillance cameras' observations.
    Its category is the class of that maximum.
    If the confidence surpasses a threshold, the candidate is confirmed.
    If the category changes, the detection is a false positive.

Where the paper is silent: the confidence in a class by one kind of source is the mean score of its detections, an object needs
``min_detections`` (VLN-Game), and a confirmed object stays confirmed a little below the threshold (``hysteresis``).
"""

from __future__ import annotations

from collections.abc import Mapping

from surveilnav.services.fusion.core.objects.assessment import Assessment, Status
from surveilnav.services.fusion.core.objects.confidences import Confidences
from surveilnav.services.fusion.core.objects.config import PaperConfirmationConfig
from surveilnav.services.fusion.core.objects.evidence import Evidence, ScoreSum


class PaperConfirmation:
    """The paper's rule (see ``ConfirmationRule``). It counts every detection in full, from any distance, and ignores misses."""

    def __init__(self, config: PaperConfirmationConfig) -> None:
        self._config = config

    def confidences(self, evidence: Evidence) -> Confidences:
        """The mean score of the detections of each class."""
        return Confidences(_means(evidence.robot), _means(evidence.surveillance))

    def update(self, evidence: Evidence) -> None:
        """Sets the category to the class of the maximum confidence, and records a flip if it was another one before."""
        if not self._config.flip_rejects:
            return
        label, _ = self.confidences(evidence).maximum
        if not evidence.category:
            evidence.category = label
        elif evidence.category != label:
            evidence.flip(label)

    def assess(self, evidence: Evidence, previous: Status) -> Assessment:
        config = self._config
        # confidence: maximum over robot and surveillance; category: class of the maximum
        label, confidence = self.confidences(evidence).maximum
        # the category has changed: a false positive
        if evidence.flipped is not None:
            old, new = evidence.flipped
            return Assessment(label, confidence, "rejected", f"false positive: first taken for {old}, then for {new}")
        n = evidence.count(label)
        if n < config.min_detections:
            reason = f"{n} of at least {config.min_detections} detections of a {label}"
            return Assessment(label, confidence, "candidate", reason)
        # above the threshold: confirmed
        threshold = config.min_confidence * (config.hysteresis if previous == "confirmed" else 1.0)
        if confidence >= threshold:
            return Assessment(label, confidence, "confirmed", f"{label} {confidence:.2f} by {n} detections")
        return Assessment(label, confidence, "candidate", f"confidence {confidence:.2f} < {threshold:g}")


def _means(sums: Mapping[str, ScoreSum]) -> dict[str, float]:
    return {label: s.total / s.n for label, s in sums.items()}
