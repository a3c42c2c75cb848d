"""How sure robots and surveillance cameras are of each class that an object may have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

ClassConfidence = tuple[str, float]


@dataclass(frozen=True, slots=True)
class Confidences:
    """Confidence 0-1 in each class of an object.

    Attributes:
        robot: by robots' detections alone.
        surveillance: by surveillance cameras' detections alone.
        joint: by a rule that weighs all detections together; None: the higher of both counts (the paper).
    """

    robot: Mapping[str, float]
    surveillance: Mapping[str, float]
    joint: Mapping[str, float] | None = None

    @property
    def best_robot(self) -> ClassConfidence:
        """The class that robots are surest of, and their confidence; ("", 0) if no robot has detected the object."""
        return _best(self.robot)

    @property
    def best_surveillance(self) -> ClassConfidence:
        """The class that cameras are surest of, and their confidence; ("", 0) if no camera has detected the object."""
        return _best(self.surveillance)

    @property
    def maximum(self) -> ClassConfidence:
        """The paper's confidence of an object, the maximum over robot and surveillance, and the class of that maximum."""
        if self.joint is not None:
            return _best(self.joint)
        robot, surveillance = self.best_robot, self.best_surveillance
        return robot if robot[1] >= surveillance[1] else surveillance

    def of_class(self, label: str) -> float:
        """The confidence in one class by all sources; 0 for a class that nobody has named."""
        if self.joint is not None:
            return self.joint.get(label, 0.0)
        return max(self.robot.get(label, 0.0), self.surveillance.get(label, 0.0))

    def by_class(self) -> dict[str, float]:
        """The confidence in each class by all sources."""
        return {label: self.of_class(label) for label in sorted({*self.robot, *self.surveillance})}


def _best(confidences: Mapping[str, float]) -> ClassConfidence:
    label = max(sorted(confidences), key=confidences.__getitem__, default="")
    return label, confidences.get(label, 0.0)
