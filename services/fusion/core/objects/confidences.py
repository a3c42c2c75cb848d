"""How sure robots and surveillance cameras are of each class that an object may have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

ClassConfidence = tuple[str, float]


@dataclass(frozen=True, slots=True)
class Confidences:
    """Confidence 0-1 by class: of robots' detections, and of surveillance cameras'.

    ``joint``: of all together, by a rule that weighs them jointly; None: the higher of both (the paper).
    """

    robot: Mapping[str, float]
    surveillance: Mapping[str, float]
    joint: Mapping[str, float] | None = None

    @property
    def best_robot(self) -> ClassConfidence:
        """The class that robots believe most; ("", 0) if they saw nothing."""
        return _best(self.robot)

    @property
    def best_surveillance(self) -> ClassConfidence:
        """The class that cameras believe most; ("", 0) if they saw nothing."""
        return _best(self.surveillance)

    @property
    def maximum(self) -> ClassConfidence:
        """The paper's confidence of an object, the maximum over robot and surveillance, and the class of that maximum."""
        if self.joint is not None:
            return _best(self.joint)
        robot, surveillance = self.best_robot, self.best_surveillance
        return robot if robot[1] >= surveillance[1] else surveillance

    def of(self, label: str) -> float:
        """The joint one, or the higher of both, for one class."""
        if self.joint is not None:
            return self.joint.get(label, 0.0)
        return max(self.robot.get(label, 0.0), self.surveillance.get(label, 0.0))

    def by_class(self) -> dict[str, float]:
        """``of`` every class, by name."""
        return {label: self.of(label) for label in sorted({*self.robot, *self.surveillance})}

    def rival(self, label: str) -> ClassConfidence:
        """The class most believed besides ``label``; ("", 0) if there is none."""
        others = [(confidence, name) for name, confidence in self.by_class().items() if name != label]
        confidence, name = max(others, default=(0.0, ""))
        return name, confidence


def _best(confidences: Mapping[str, float]) -> ClassConfidence:
    label = max(sorted(confidences), key=confidences.__getitem__, default="")
    return label, confidences.get(label, 0.0)
