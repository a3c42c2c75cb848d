"""Confirmation by one chance for all words: what all views and misses together make an object likely to be.

Each place that an object was seen from has the log-odds of its best detection there (``Support.log_odds``): views from one
place see the same and aren't independent, and neither are views from several, so their number counts by its logarithm.
The log-odds of a class are a sum of the mean and the best of them, the number of places, how many places saw another class
instead, and how often a robot had it in plain view and didn't see it. The weights are the same for all words
(``PosteriorConfig``), fitted to objects of train buildings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from services.fusion.core.assessment import Assessment, Status
from services.fusion.core.confidences import Confidences
from services.fusion.core.config import PosteriorConfig
from services.fusion.core.evidence import NOTHING, Evidence, Support


class PosteriorConfirmation:
    """See ``Confirmation``."""

    def __init__(self, config: PosteriorConfig) -> None:
        self._config = config

    def weigh(self, range_m: float, *, is_robot: bool) -> tuple[float, bool]:
        """Every detection counts by its chance alone; near is what a robot sees within ``near_m``."""
        return 1.0, is_robot and range_m <= self._config.near_m

    def confidences(self, evidence: Evidence) -> Confidences:
        """Chances of each class: by robots alone, by cameras alone, and by all."""
        labels = sorted({*evidence.robot, *evidence.surveillance})
        joint = {label: self.chance(evidence, label) for label in labels}
        return Confidences(self._alone(evidence.robot), self._alone(evidence.surveillance), joint)

    def _alone(self, supports: Mapping[str, Support]) -> dict[str, float]:
        own = Evidence(robot=dict(supports))
        return {label: self.chance(own, label) for label in supports}

    def chance(self, evidence: Evidence, label: str) -> float:
        """How likely the object is of a class, 0-1."""
        c = self._config
        cameras = evidence.surveillance.get(label, NOTHING).log_odds
        mine = [*evidence.robot.get(label, NOTHING).log_odds.values(), *cameras.values()]
        if not mine:
            return 0.0
        others = sum(
            len(support.log_odds)
            for supports in (evidence.robot, evidence.surveillance)
            for name, support in supports.items()
            if name != label
        )
        mean, more = sum(mine) / len(mine), math.log(len(mine))
        log_odds = c.even + c.mean * mean + c.best * max(mine) + (c.more + c.more_mean * mean) * more
        log_odds += (
            c.seen_by_camera * bool(cameras) - c.others * math.log1p(others) - c.misses * math.sqrt(evidence.misses)
        )
        return 1.0 / (1.0 + math.exp(-log_odds))

    def settle(self, evidence: Evidence) -> None:
        """The class is the likeliest at any time."""
        evidence.settled = self.confidences(evidence).maximum[0]

    def assess(self, evidence: Evidence, was: Status) -> Assessment:
        """See ``Confirmation``."""
        c, label = self._config, evidence.settled
        chance = self.chance(evidence, label)
        needed = c.min_chance * (c.hysteresis if was == "confirmed" else 1.0)
        near, views = evidence.robot.get(label, NOTHING).near, len(evidence.surveillance.get(label, NOTHING).places)
        by = f"{near} near robot detections, {views} camera views, {evidence.misses} misses"
        if chance < c.reject_chance and evidence.misses >= c.reject_misses:
            return Assessment(label, chance, "rejected", f"{label} by {chance:.2f} only: {by}")
        if chance < needed:
            return Assessment(label, chance, "candidate", f"{label} by {chance:.2f} < {needed:g}: {by}")
        if near == 0 and views < c.camera_views:
            return Assessment(label, chance, "candidate", f"no robot saw it from within {c.near_m:g} m: {by}")
        return Assessment(label, chance, "confirmed", f"{label} by {chance:.2f}: {by}")
