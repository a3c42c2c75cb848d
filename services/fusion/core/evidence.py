"""What speaks for and against an object, and the verdict: candidate, confirmed or rejected."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from services.fusion.core.config import ObjectConfig

Status = Literal["candidate", "confirmed", "rejected"]
_MAX_PLACES = 16  # more different viewpoints than any rule asks for


@dataclass(slots=True)
class Support:
    """What one kind of source (robots, or surveillance) says for one class of one object."""

    n: int = 0
    near: int = 0
    weight: float = 0.0
    weighted_score: float = 0.0
    places: set[tuple[object, ...]] = field(default_factory=set)

    def add(self, score: float, weight: float, near: bool, place: tuple[object, ...]) -> None:
        """One detection; ``place``: where it was seen from, to the metre or so."""
        self.n += 1
        self.near += near
        self.weight += weight
        self.weighted_score += weight * score
        if len(self.places) < _MAX_PLACES:
            self.places.add(place)

    def absorb(self, other: Support) -> None:
        """Adds what another object, now found to be this one, had."""
        self.n += other.n
        self.near += other.near
        self.weight += other.weight
        self.weighted_score += other.weighted_score
        self.places = set(sorted(self.places | other.places, key=repr)[:_MAX_PLACES])


_NOTHING = Support()


def _support(n: int, near: int, weight: float, weighted_score: float, places: list[list[object]]) -> Support:
    return Support(n, near, weight, weighted_score, {tuple(place) for place in places})


@dataclass(slots=True)
class Evidence:
    """All that was said about one object. ``misses``: close robot views that should have shown its class and didn't."""

    robot: dict[str, Support] = field(default_factory=dict)
    surveillance: dict[str, Support] = field(default_factory=dict)
    misses: int = 0
    settled: str = ""
    flipped: tuple[str, str, int] | None = None  # from, to, and how often "to" had been seen then

    def state(self) -> dict[str, Any]:
        """All of it, as plain values, for ``of_state``."""
        kinds = {"robot": self.robot, "surveillance": self.surveillance}
        supports = {
            kind: {
                label: [s.n, s.near, s.weight, s.weighted_score, sorted((list(p) for p in s.places), key=repr)]
                for label, s in of_kind.items()
            }
            for kind, of_kind in kinds.items()
        }
        return {**supports, "misses": self.misses, "settled": self.settled, "flipped": self.flipped}

    @classmethod
    def of_state(cls, state: dict[str, Any]) -> Evidence:
        """The evidence that ``state`` was taken of."""
        robot, surveillance = (
            {label: _support(*fields) for label, fields in state[kind].items()} for kind in ("robot", "surveillance")
        )
        flipped = None
        if state["flipped"] is not None:
            old, new, then = state["flipped"]
            flipped = old, new, then
        return cls(robot, surveillance, state["misses"], state["settled"], flipped)

    def confidences(self, is_robot: bool, config: ObjectConfig) -> dict[str, float]:
        """Confidence of each class from robots or from surveillance.

        ``share``: weighted scores of the class over the weight of all evidence: other classes and misses count as 0
        (ApexNav's rule). ``mean``: the class's own mean score.
        """
        supports = self.robot if is_robot else self.surveillance
        everything = sum(s.weight for s in supports.values())
        own = config.confidence == "mean"
        return {
            label: s.weighted_score / ((s.weight if own else everything) + self.misses * _miss_weight(label, config))
            for label, s in supports.items()
        }

    def best(self, is_robot: bool, config: ObjectConfig) -> tuple[str, float]:
        """The class that one kind of source believes most, and its confidence; ("", 0) if it saw nothing."""
        found = self.confidences(is_robot, config)
        label = max(sorted(found), key=found.__getitem__, default="")
        return label, found.get(label, 0.0)

    def count(self, label: str) -> int:
        """Detections of a class by all sources."""
        return self.robot.get(label, _NOTHING).n + self.surveillance.get(label, _NOTHING).n

    def weight(self, label: str) -> float:
        """Their weight."""
        return self.robot.get(label, _NOTHING).weight + self.surveillance.get(label, _NOTHING).weight

    def absorb(self, other: Evidence) -> None:
        """Adds another object's."""
        for mine, theirs in ((self.robot, other.robot), (self.surveillance, other.surveillance)):
            for label, support in theirs.items():
                mine.setdefault(label, Support()).absorb(support)
        self.misses += other.misses
        self.settled = self.settled or other.settled
        self.flipped = self.flipped or other.flipped


@dataclass(frozen=True, slots=True)
class Verdict:
    """What follows from the evidence; ``reason`` is for people."""

    label: str
    confidence: float
    status: Status
    reason: str


def judge(evidence: Evidence, was: Status, config: ObjectConfig) -> Verdict:
    """The verdict on an object that ``was`` of some status before; updates ``settled`` and ``flipped`` of its evidence.

    The paper: confidence is the maximum over robot and surveillance, the class that of the maximum; above a threshold
    the object is confirmed; a change of class is a false positive. Beyond it (``flip == "sustained"``): a class is
    settled by a few detections, and only a few weightier ones of another class unseat it.
    """
    label, confidence = _class_of_maximum(evidence, config)
    n = evidence.count(label)
    if evidence.settled and evidence.settled != label:
        old = evidence.settled
        enough = n >= config.flip_detections and evidence.weight(label) >= config.flip_margin * evidence.weight(old)
        if config.flip == "literal" or enough:
            evidence.flipped = old, label, n
            evidence.settled = label
            evidence.misses = 0
            label, confidence = _class_of_maximum(evidence, config)
        else:
            label, confidence = old, max(evidence.confidences(kind, config).get(old, 0.0) for kind in (True, False))
            n = evidence.count(old)
    elif not evidence.settled and (config.flip == "literal" or n >= config.flip_detections):
        evidence.settled = label

    if evidence.flipped is not None:
        old, new, then = evidence.flipped
        if config.flip == "literal" or n < then + config.revive_detections:
            return Verdict(label, confidence, "rejected", f"false positive: first taken for {old}, then for {new}")
    robot, cameras = evidence.robot.get(label, _NOTHING), evidence.surveillance.get(label, _NOTHING)
    expected = config.reject_share * _recall(label, config) * (robot.near + evidence.misses)
    if evidence.misses >= config.reject_misses and robot.near < expected:
        return Verdict(
            label, confidence, "rejected",
            f"a robot had it in plain view {evidence.misses} times and saw no {label} ({robot.near} times it did)",
        )  # fmt: skip
    if n < config.min_detections:
        return Verdict(
            label, confidence, "candidate", f"{n} of at least {config.min_detections} detections of a {label}"
        )
    rival = _rival(evidence, label, config)
    if config.confirm_margins.get(label, config.confirm_margin) * rival[1] > confidence:
        return Verdict(label, confidence, "candidate", f"{label} {confidence:.2f}, but {rival[0]} {rival[1]:.2f}")
    # once confirmed, a little less will do: no flicker at the threshold
    lenient = config.confirm_hysteresis if was == "confirmed" else 1.0
    n_sightings = robot.near + len(cameras.places)
    enough_score = config.confirm_scores.get(label, config.confirm_score) + _early(n_sightings, config)
    by_robot = evidence.confidences(True, config).get(label, 0.0)
    by_cameras = evidence.confidences(False, config).get(label, 0.0)
    enough_seen = config.confirm_detections.get(label, config.confirm_robot_detections)
    sightings = f"{robot.near} near robot detections, {len(cameras.places)} camera views"
    if (
        robot.near >= 1
        and n_sightings >= enough_seen
        and len(robot.places) + len(cameras.places) >= config.confirm_robot_poses
        and max(by_robot, by_cameras) >= lenient * enough_score
    ):
        return Verdict(label, confidence, "confirmed", f"{label} {confidence:.2f} by {sightings}")
    n_views = len(cameras.places)
    if n_views >= config.confirm_camera_views and by_cameras >= lenient * config.confirm_camera_score:
        return Verdict(label, confidence, "confirmed", f"{label} {by_cameras:.2f} by {n_views} camera views")
    wanting = (
        f"confidence {confidence:.2f} < {enough_score:g}"
        if confidence < enough_score
        else f"needs {enough_seen} sightings, one of them a robot's within {config.near_m:g} m"
    )
    return Verdict(label, confidence, "candidate", f"{wanting}; {sightings}, {evidence.misses} misses")


def _early(n_sightings: int, config: ObjectConfig) -> float:
    """How much more an object needs that was seen only so often: a few views agree by chance."""
    first, settled = config.confirm_robot_detections, config.confirm_settled
    return config.confirm_early * min(1.0, max(0.0, (settled - n_sightings) / max(1, settled - first)))


def _rival(evidence: Evidence, label: str, config: ObjectConfig) -> tuple[str, float]:
    """The other class that most speaks for, and its confidence; ("", 0) if nothing does."""
    found = [
        (c, name) for kind in (True, False) for name, c in evidence.confidences(kind, config).items() if name != label
    ]
    confidence, name = max(found, default=(0.0, ""))
    return name, confidence


_USUAL_RECALL = 0.8


def _recall(label: str, config: ObjectConfig) -> float:
    return config.recall.get(label, _USUAL_RECALL)


def _miss_weight(label: str, config: ObjectConfig) -> float:
    """A miss weighs by how much it surprises: -log of the share of views in which a thing of the class is missed."""
    return config.miss_weight * math.log(1.0 - _recall(label, config)) / math.log(1.0 - _USUAL_RECALL)


def _class_of_maximum(evidence: Evidence, config: ObjectConfig) -> tuple[str, float]:
    by_robot, by_cameras = evidence.best(True, config), evidence.best(False, config)
    return by_robot if by_robot[1] >= by_cameras[1] else by_cameras
